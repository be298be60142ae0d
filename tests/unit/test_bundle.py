"""The files that pods need fit into a ConfigMap, or it is said why not."""

from __future__ import annotations

import base64

import pytest

from fleet.errors import SpecError
from fleet_operator.compiler.bundle import Bundle


def test_text_and_bytes_go_where_a_config_map_has_them() -> None:
    bundle = Bundle({"own.py": b"x = 1\n", "pkg/sub.py": b"", "model.npz": b"\xff\x00"})
    assert bundle.data() == {
        "data": {"own.py": "x = 1\n", "pkg.sub.py": ""},
        "binaryData": {"model.npz": base64.b64encode(b"\xff\x00").decode()},
    }
    assert bundle.items() == [
        {"key": "model.npz", "path": "model.npz"},
        {"key": "own.py", "path": "own.py"},
        {"key": "pkg.sub.py", "path": "pkg/sub.py"},
    ]


def test_the_digest_depends_on_names_and_contents_only() -> None:
    one = Bundle({"a.py": b"1", "b.py": b"2"})
    assert one.digest == Bundle({"b.py": b"2", "a.py": b"1"}).digest
    assert one.digest != Bundle({"a.py": b"12", "b.py": b""}).digest
    assert one.digest != Bundle({"a.py": b"2", "b.py": b"1"}).digest


def test_too_large_a_bundle_says_to_build_an_image() -> None:
    with pytest.raises(SpecError) as caught:
        Bundle({"big.py": b"#" * 1_000_000, "small.py": b"#"})
    assert str(caught.value) == (
        "spec.map.function: the functions and the files that they need are 977 KiB, more than the 900 KiB that a "
        "ConfigMap can carry; largest: big.py (977 KiB), small.py (0 KiB); "
        "build an image with the functions and name it in spec.map.image and spec.eval.image"
    )


def test_names_that_a_config_map_cannot_have_are_refused() -> None:
    with pytest.raises(SpecError, match=r"cannot carry a file called 'profil é\.yaml'"):
        Bundle({"profil é.yaml": b""})
    for path in ("/tmp/x.py", "a/../../x.py", "../x.py", "./x.py", "a//x.py", "a/"):
        with pytest.raises(SpecError, match="cannot carry a file called"):
            Bundle({path: b""})
    with pytest.raises(SpecError, match=r"a\.b\.yaml and a/b\.yaml have the same key"):
        Bundle({"a.b.yaml": b"", "a/b.yaml": b""})
