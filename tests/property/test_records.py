"""An agent's log survives torn lines and lines written twice."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from fleet.missions.records import Record, read_log


def _record(step: int) -> Record:
    return Record(step, step, 0, step, True, (0.5, float(step)), 3, 1, "South", 6.0 * step, 700.0 * step)


def test_a_log_reads_as_it_was_written() -> None:
    records = tuple(_record(step) for step in range(5))
    assert read_log(b"".join(record.to_line() for record in records)) == records


@given(st.integers(0, 6), st.data())
def test_a_torn_last_line_is_dropped_and_its_step_may_be_written_again(count: int, data: st.DataObject) -> None:
    records = tuple(_record(step) for step in range(count + 1))
    whole = b"".join(record.to_line() for record in records[:-1])
    line = records[-1].to_line()
    torn = line[: data.draw(st.integers(0, len(line) - 2))]
    assert read_log(whole + torn) == records[:-1]
    assert read_log(whole + torn + line) == records


def test_a_line_written_twice_counts_once() -> None:
    line = _record(0).to_line()
    assert read_log(line + line + _record(1).to_line()) == (_record(0), _record(1))


def test_records_after_a_missing_step_do_not_count() -> None:
    assert read_log(_record(0).to_line() + _record(2).to_line()) == (_record(0),)


def test_garbage_and_records_of_another_form_are_passed_over() -> None:
    assert read_log(b'\xff\xfe{"step": 0}\n[1]\nnull\n' + _record(0).to_line()) == (_record(0),)
