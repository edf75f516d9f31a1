"""A setting is known by its value, however it is spelled."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.audit.setting import canonical, setting, values

NUMBERS = st.integers(-(10**6), 10**6) | st.floats(allow_nan=False, allow_infinity=False)
VALUES = st.recursive(st.none() | st.booleans() | NUMBERS | st.text(), lambda part: st.lists(part, max_size=3))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("a=100", "a=1e2"),
        ("a=100.0", "+a=100"),
        ("a=0", "a=-0.0"),
        ("a=[9]", "a=[9.0]"),
        ("a=true", "a=True"),
        ("a=null", "a=Null"),
        ("a='x'", "a=x"),
        ("a={b:1,c:2}", "a={c:2.0,b:1}"),
    ],
)
def test_spellings_of_one_value_are_one_setting(one: str, other: str):
    assert setting([one]) == setting([other])


@pytest.mark.parametrize(
    ("one", "other"), [("a=1", "a=true"), ("a=1", "a='1'"), ("a=null", "a='null'"), ("a=1", "b=1")]
)
def test_values_that_differ_are_two_settings(one: str, other: str):
    assert setting([one]) != setting([other])


def test_a_setting_leaves_out_what_is_fixed_by_value_and_knows_no_order():
    assert setting(["b=2", "a=1", "c=3.0"], fixed=["c=3"]) == setting(["a=1.0", "b=2"]) == ("a=1", "b=2")


@given(VALUES, VALUES)
def test_values_have_the_same_text_if_and_only_if_they_are_equal(one: object, other: object):
    def typed(value: object) -> object:  # Python takes True for 1
        if isinstance(value, list):
            return [typed(part) for part in value]
        return (isinstance(value, bool), value)

    assert (canonical(one) == canonical(other)) == (typed(one) == typed(other))


@given(NUMBERS)
def test_a_number_keeps_its_setting_if_it_is_spelled_as_its_text(number: float):
    assert canonical(values([f"a={canonical(number)}"])["a"]) == canonical(number)
