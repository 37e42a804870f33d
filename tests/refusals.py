"""How tests ask for a refusal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


def refusal(error: type[Exception], call: Callable[..., object], *given: Any, **asked: Any) -> str:
    """Message of the error that a call raises; it is one line."""
    with pytest.raises(error) as caught:
        call(*given, **asked)
    message = str(caught.value)
    assert message and "\n" not in message
    return message
