"""Which plan scouts a field best: fields, rivals, a judge and statistics; run it with `python -m bench.scouting`."""
