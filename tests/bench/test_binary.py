"""That the bench of binary forms still runs; how fast they are it does not say."""

from bench.binary import rows


def test_the_bench_measures_each_form() -> None:
    """Bytes and time of four forms of two resources; a frame of 20 joints has the size that the wire says."""
    found = {row.name: row for row in rows(0.1)}
    assert len(found) == 16
    assert found["message about the joint state of 20 joints, binary frame, B"].value == 40 + 3 * 20 * 8
    assert found["message about one rotation, binary frame, B"].value == 40
    for name, row in found.items():
        assert (row.ratio is None) == ("Turtle" in name), name
        assert row.unit == ("B" if name.endswith(", B") else "us CPU"), name
