"""The benchmark of binary formats runs; its speed is not tested."""

from bench.binary import rows


def test_the_bench_measures_each_form() -> None:
    """It yields bytes and time of four formats of two resources; a frame of 20 joints has the documented size."""
    found = {row.name: row for row in rows(0.1)}
    assert len(found) == 16
    assert found["message about the joint state of 20 joints, binary frame, B"].value == 40 + 3 * 20 * 8
    assert found["message about one rotation, binary frame, B"].value == 40
    for name, row in found.items():
        assert (row.ratio is None) == ("Turtle" in name), name
        assert row.unit == ("B" if name.endswith(", B") else "us CPU"), name
