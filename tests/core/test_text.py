"""Lists in sentences."""

from frischid.core.text import each_of, listed


def test_lists():
    assert [listed(x) for x in ((), ("a",), ("a", "b"), ("a", "b", "c"))] == ["", "a", "a and b", "a, b and c"]
    assert [each_of(x) for x in ((), ("a",), ("a", "b"))] == ["the robot", "a", "each of a and b"]
