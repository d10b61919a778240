"""Pictures as files: MP4 through PyAV, PNG through Pillow, and which OpenGL draws them where there is no screen."""

from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import io
import os
import sys
from collections.abc import Iterable
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from retarget.core.errors import UsageError

CODECS = ("libx264", "mpeg4")
"""The first that the FFmpeg at hand has is used."""


def choose_opengl() -> None:
    """Set MUJOCO_GL, unless it is set, to what draws without a screen. Must come before mujoco is imported."""
    if "MUJOCO_GL" in os.environ or not sys.platform.startswith("linux"):
        return
    # Whether a library is there is seen by loading it: importing mujoco fails when MUJOCO_GL names one that is not.
    for library, function, choice in (("EGL", "eglGetDisplay", "egl"), ("OSMesa", "OSMesaCreateContextExt", "osmesa")):
        path = ctypes.util.find_library(library)
        with contextlib.suppress(OSError):
            if path and hasattr(ctypes.CDLL(path), function):
                os.environ["MUJOCO_GL"] = choice
                return


def check_installed() -> None:
    """Raise `UsageError` unless videos can be written."""
    if find_spec("av") is None:
        raise UsageError("--video needs PyAV, which is not installed; pip install 'retarget[video]'")


def write_mp4(path: Path, images: Iterable[Any], rate_hz: int) -> None:
    """Write images (height, width, 3) uint8, even sizes, as MP4 at `path`: whole, or not at all."""
    import av
    from retarget.formats import new_file

    codec = next((name for name in CODECS if name in av.codecs_available), None)
    if codec is None:
        raise UsageError(f"--video: this PyAV has no encoder for MP4; expected one of {', '.join(CODECS)}")
    with new_file(path) as file, av.open(file, "w", format="mp4") as container:
        stream: Any = None
        for image in images:
            if stream is None:
                stream = container.add_stream(codec, rate=Fraction(rate_hz))
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = "yuv420p"
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")):
                container.mux(packet)
        if stream is not None:
            for packet in stream.encode():
                container.mux(packet)


def png(image: Any, colours: int = 128) -> bytes:
    """The image as PNG of at most `colours` colours, a third of the size."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).quantize(colours).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def captioned(image: Any, text: str, warning: str = "") -> Any:
    """The image with `text` in its lower left corner and `warning` in red above it."""
    import numpy as np
    from PIL import Image, ImageDraw, ImageFont

    canvas = Image.fromarray(image)
    draw = ImageDraw.Draw(canvas)
    size = max(12, image.shape[0] // 30)
    font = ImageFont.load_default(size)
    bottom = image.shape[0] - int(1.8 * size)
    draw.text((size, bottom), text, fill=(43, 47, 54), font=font)
    if warning:
        draw.text((size, bottom - int(1.4 * size)), warning, fill=(179, 38, 30), font=font)
    return np.asarray(canvas)
