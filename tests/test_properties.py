"""Properties that fail must say why, whatever they fail on."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def test_a_property_that_fails_on_something_large_shows_its_own_failure() -> None:
    @given(large=st.just("0" * 40_000))
    @settings(database=None, max_examples=1)
    def fails(large: str) -> None:
        assert len(large) < 10, "too long"

    with pytest.raises(AssertionError, match="too long"):
        fails()
