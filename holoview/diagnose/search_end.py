"""The end of a search before it is done: after some time, or when somebody asks for it. What it had found is kept."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

from holoview.util.processor_share import processor_share


class _Score(Protocol):
    @property
    def causes(self) -> tuple[str, ...]: ...
    @property
    def chi2_per_pixel(self) -> float: ...
    @property
    def excess(self) -> float: ...


class _Result(Protocol):
    @property
    def nominal(self) -> _Score: ...
    @property
    def best(self) -> _Score: ...
    @property
    def candidates(self) -> tuple[Any, ...]: ...


R = TypeVar("R", bound=_Result)


class SearchEnded(Exception):
    """Raised where light is predicted, once a search has to end."""


class SearchEnd:
    """When a search has to end.

    time_s: after so long, counted from now. is_asked: whether somebody wants the search to end; only this process asks.
    last_begin: share of the time after which nothing new is begun. max_stretch: where other programs use the processor
    too, the time is divided by the share of it that the search gets, up to this factor.
    """

    def __init__(
        self,
        time_s: float = math.inf,
        is_asked: Callable[[], bool] | None = None,
        last_begin: float = 1.0,
        max_stretch: float = 1.0,
    ) -> None:
        self._began = time.monotonic()  # the same clock in all processes of a machine
        self.time_s, self._last_begin, self._max_stretch = time_s, last_begin, max_stretch
        self._is_asked = is_asked

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_is_asked": None}

    def after_share(self, share: float) -> SearchEnd:
        """The end of a part of the search that may take this share of the time, from the same beginning."""
        part = SearchEnd(share * self.time_s, self._is_asked, self._last_begin, self._max_stretch)
        part._began = self._began
        return part

    def check(self) -> None:
        """Raises SearchEnded once the time is over or somebody asked for the end."""
        if self._is_after(self.time_s) or self.was_asked:
            raise SearchEnded

    @property
    def is_near(self) -> bool:
        """Whether too little time is left to begin something new."""
        return self._is_after(self._last_begin * self.time_s)

    def _is_after(self, time_s: float) -> bool:
        """Whether this part of the time has passed, stretched where the processor is shared."""
        passed = time.monotonic() - self._began
        if passed <= time_s or self._max_stretch <= 1:
            return passed > time_s
        return passed > time_s * min(1 / processor_share(), self._max_stretch)

    @property
    def was_asked(self) -> bool:
        """Whether somebody asked for the end."""
        return self._is_asked is not None and self._is_asked()


NEVER = SearchEnd()


def describe_so_far(result: _Result) -> str:
    """A sentence on what a search has found so far."""
    before, after = result.nominal.chi2_per_pixel, result.best.chi2_per_pixel
    if not result.best.causes:
        return f"no cause yet (held-out captures: χ²/n {before:.4g}, noise: 1)"
    return f"{' and '.join(result.best.causes)} (held-out captures: χ²/n {before:.4g} → {after:.4g}, noise: 1)"


class BestSoFar(Generic[R]):
    """The best that a search has found so far.

    on_change: called with each result that names other causes than the last one, or leaves less than half its excess.
    Once causes were named it isn't called where a search, begun anew, has found none yet.
    """

    def __init__(self, on_change: Callable[[R], None] | None = None) -> None:
        self._on_change, self._has_named = on_change, False
        self.result: R | None = None

    def __getstate__(self) -> dict[str, object]:
        return {"_on_change": None, "_has_named": False, "result": None}  # another process has nothing to tell

    def note(self, result: R) -> None:
        """Keeps a result; one without candidates is kept only if there is no other."""
        before, self.result = self.result, result if result.candidates or self.result is None else self.result
        if self.result is before or self._on_change is None:
            return
        if self._has_named and not self.result.best.causes:
            return
        self._has_named |= bool(self.result.best.causes)
        same = before is not None and before.best.causes == self.result.best.causes
        if not same or before is None or 2 * self.result.best.excess < before.best.excess:
            self._on_change(self.result)

    def clear(self) -> None:
        """Forgets what was found, for a search that begins anew."""
        self.result = None
