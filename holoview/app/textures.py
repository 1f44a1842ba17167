"""Small textures of pixels for panels: icons, plots, previews."""

from __future__ import annotations

from typing import Any

import numpy as np
import wgpu
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.app.window import Window
from holoview.gpu.device import Device


class TextureCache:
    """Textures by key, each uploaded once for an array."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self.window: Window | None = None
        self._known: dict[str, tuple[NDArray[np.uint8], imgui.ImTextureRef]] = {}

    def get(self, key: str, pixels: NDArray[np.uint8]) -> imgui.ImTextureRef:
        """The texture of an array (y, x, 3 or 4); the one that had this key before is forgotten."""
        assert self.window is not None
        known = self._known.get(key)
        if known is not None and known[0] is pixels:
            return known[1]
        if known is not None:
            self.window.forget_texture(known[1])
        reference = self.window.texture(self._upload(key, pixels))
        self._known[key] = (pixels, reference)
        return reference

    def _upload(self, key: str, pixels: NDArray[np.uint8]) -> Any:
        rows, columns = pixels.shape[:2]
        opaque = np.full((rows, columns, 4), 255, np.uint8)
        opaque[..., : pixels.shape[2]] = pixels
        self._device.check_alive()
        usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
        texture = self._device.raw.create_texture(
            label=key, size=(columns, rows, 1), format=wgpu.TextureFormat.rgba8unorm, usage=usage
        )
        self._device.raw.queue.write_texture(
            {"texture": texture, "mip_level": 0, "origin": (0, 0, 0)},
            opaque,
            {"bytes_per_row": 4 * columns, "rows_per_image": rows},
            (columns, rows, 1),
        )
        return texture.create_view()
