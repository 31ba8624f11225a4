"""Images of the levels, packed as PNG files. Other threads encode them."""

from __future__ import annotations

import tempfile
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..steps import Steps, waited


class PackedImages:
    """New images, which have their pixels once all are `packed`."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(2, thread_name_prefix="leafcloud")  # They start at the first image.
        self._files: list[tuple[bpy.types.Image, Future[bytes]]] = []

    def add(self, name: str, pixels: NDArray[np.uint8], *, data: bool = False) -> bpy.types.Image:
        """Create an image from `pixels` (h, w, 4), row 0 on top.

        They are sRGB with straight alpha; with `data` they are not colors.
        """
        height, width = pixels.shape[:2]
        image = bpy.data.images.new(name, width, height)
        image.filepath_raw = f"//{name}.png"
        # Transparent texels hold dilated colors for filtering. They must not be multiplied by alpha.
        image.alpha_mode = "CHANNEL_PACKED"
        if data:
            image.colorspace_settings.name = "Non-Color"
        self._files.append((image, self._threads.submit(_png, pixels)))
        return image

    def packed(self) -> Steps[None]:
        """Give the images their pixels, in steps."""
        for image, file in self._files:
            encoded = yield from waited(file)
            image.pack(data=encoded, data_len=len(encoded))
            image.source = "FILE"
            for packed in image.packed_files:
                packed.filepath = image.filepath_raw
            yield

    def close(self) -> None:
        """End the threads. Images that are not packed stay empty."""
        self._threads.shutdown(wait=False, cancel_futures=True)


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode an image. The core does it, so that the same pixels give the same bytes in every Blender version."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.png"
        leafcloud.write_png(str(path), pixels)
        return path.read_bytes()
