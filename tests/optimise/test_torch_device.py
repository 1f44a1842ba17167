"""The torch device that is chosen, and the error when it isn't available."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from holoview.optimise.parallel import resolve_torch_device
from holoview.util.errors import UserError


@pytest.fixture
def _cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)


@pytest.fixture
def _only_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)


@pytest.mark.usefixtures("_only_the_processor")
def test_without_a_graphics_card_it_is_the_processor() -> None:
    assert resolve_torch_device() == resolve_torch_device("auto") == resolve_torch_device("cpu") == "cpu"


@pytest.mark.usefixtures("_cuda")
def test_a_graphics_card_is_preferred() -> None:
    assert resolve_torch_device() == "cuda"


@pytest.mark.usefixtures("_only_the_processor")
@pytest.mark.parametrize("name", ["cuda", "cuda:1", "mps", "gpu", ""])
def test_a_device_that_is_not_there_is_refused_with_those_that_are(name: str) -> None:
    with pytest.raises(UserError, match=f'device: "{name}" isn\'t available; expected one of cpu'):
        resolve_torch_device(name)


@pytest.mark.usefixtures("_cuda")
def test_a_device_that_cannot_transform_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> torch.Tensor:
        raise RuntimeError("no such ordinal\nand much more")

    monkeypatch.setattr(torch, "ones", broken)
    with pytest.raises(UserError, match='device: "cuda:7" doesn\'t work: no such ordinal; expected one of cuda'):
        resolve_torch_device("cuda:7")
