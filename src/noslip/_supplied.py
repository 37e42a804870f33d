"""Methods that a higher layer supplies: a motion can be drawn, and knows nothing of drawing."""

from __future__ import annotations

from collections.abc import Callable
from types import MethodType
from typing import Any, ClassVar


class Supplied:
    """A method whose function is among :attr:`functions`, under ``Class.method``.

    Parameters
    ----------
    doc : str
        What it does.
    """

    functions: ClassVar[dict[str, Callable[..., Any]]] = {}

    def __init__(self, doc: str) -> None:
        self.__doc__ = doc

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = f"{owner.__name__}.{name}"

    def __get__(self, instance: Any, owner: type) -> Any:
        return self if instance is None else MethodType(self.functions[self._name], instance)
