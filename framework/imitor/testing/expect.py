"""How a check speaks: one sentence with the plugin, the rule and what was seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from imitor.kinds import Component, Config

T = TypeVar("T")
C = TypeVar("C", bound=Component[Any])
AnyComponent = type[Component[Any]]
Snapshot = dict[str, NDArray[Any]]
"""Copies of named arrays."""


def title(cls: AnyComponent) -> str:
    """Return how messages call a plugin: kind and name."""
    return f"{cls.kind or 'component'} '{cls.name or cls.__qualname__}'"


def expect(kept: object, cls: AnyComponent, text: str) -> None:
    """Raise an `AssertionError` about a plugin unless a rule is kept."""
    if not kept:
        raise AssertionError(f"{title(cls)}: {text}")


def fail(cls: AnyComponent, text: str) -> NoReturn:
    """Raise the `AssertionError` about a plugin; where the text is costly, cheaper than `expect`."""
    raise AssertionError(f"{title(cls)}: {text}")


def attempt(cls: AnyComponent, what: str, call: Callable[[], T]) -> T:
    """Return what a call returns; an exception becomes an `AssertionError` that says what was called."""
    try:
        return call()
    except AssertionError:
        raise
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
        if isinstance(error, ValueError) and "read-only" in str(error):
            told = f"it writes into an array that is not its own ({error}); bind a new one"
        raise AssertionError(f"{title(cls)}: {what} failed: {told}") from error


def required_options(config_type: type[Config]) -> list[str]:
    """Return the options without a default."""
    return [name for name, field in config_type.model_fields.items() if field.is_required()]


def configure(cls: AnyComponent, options: Mapping[str, Any] | None) -> Config:
    """Return a plugin's validated options.

    Raises:
        AssertionError: They do not fit, or options without a default were not given.
    """
    given = dict(options or {})
    missing = [name for name in required_options(cls.config_type) if name not in given]
    values = ", ".join(f"'{name}': ..." for name in missing)
    expect(not missing, cls, f"its options {', '.join(missing)} have no default; give a config {{{values}}}")
    try:
        return cls.config_type.model_validate(given)
    except ValidationError as error:
        raise AssertionError(f"{title(cls)}: the options {given} are refused: {error}") from error


def build(cls: type[C], options: Mapping[str, Any] | None, context: Any = None) -> C:
    """Return a plugin with these options."""
    config = configure(cls, options)
    return attempt(cls, "building it", lambda: cls(config, context))


def check_same(cls: AnyComponent, first: list[Snapshot], second: list[Snapshot], when: str) -> None:
    """Refuse two runs that differ in any bit."""
    expect(len(first) == len(second), cls, f"{when}: {len(first)} frames and then {len(second)}")
    for i, (a, b) in enumerate(zip(first, second, strict=True)):
        expect(a.keys() == b.keys(), cls, f"{when}: frame {i} has {sorted(a)} and then {sorted(b)}")
        for name in a:
            if not equal(a[name], b[name]):
                fail(
                    cls,
                    f"{when}: {name} of frame {i} is {short(a[name])} and then {short(b[name])}; "
                    "`reset` must forget everything, and randomness needs a seed",
                )


def equal(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Tell whether two arrays agree in shape and every bit, NaN with NaN."""
    if a.shape != b.shape or a.dtype != b.dtype:
        return False
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))


def short(array: NDArray[Any]) -> str:
    """Return a few values of an array as text."""
    return np.array2string(array, precision=6, threshold=8, edgeitems=2).replace("\n", "")


def is_rotation(R: NDArray[Any], tolerance: float = 1e-6) -> bool:
    """Tell whether matrices, shape (..., 3, 3), are rotations."""
    if not np.isfinite(R).all():
        return False
    square = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0)
    return bool(square < tolerance and (np.linalg.det(R) > 0).all())
