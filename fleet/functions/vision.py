"""Pictures of an observation; the only door to OpenCV.

Colours of a picture are 8 bits a channel, 0..255, in OpenCV's order blue, green, red.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Observation

# One process serves one agent; threads of OpenCV would take the cores of the other agents.
cv2.setNumThreads(1)


@dataclass(frozen=True, eq=False)
class Picture:
    """A decoded picture and what several extractors need of it.

    Args:
        bgr: uint8 [height, width, 3].
    """

    bgr: NDArray[np.uint8]

    @property
    def height(self) -> int:
        """Rows of pixels."""
        return int(self.bgr.shape[0])

    @property
    def width(self) -> int:
        """Columns of pixels."""
        return int(self.bgr.shape[1])

    @cached_property
    def means(self) -> tuple[float, float, float]:
        """Mean red, green and blue, 0..255."""
        blue, green, red, _ = cv2.mean(self.bgr)
        return red, green, blue

    @cached_property
    def grey(self) -> NDArray[np.uint8]:
        """Luma of ITU-R BT.601, uint8 [height, width]."""
        return np.asarray(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2GRAY), dtype=np.uint8)

    @cached_property
    def plantness(self) -> NDArray[np.int16]:
        """15 G - 12 R - 5 B, int16 [height, width]; positive on plants.

        It is 5 (ExG - ExR) with ExG = 2g - r - b and ExR = 1.4r - g, times the brightness of the pixel, which does
        not change the sign.
        Source: Meyer and Camargo Neto 2008, Computers and Electronics in Agriculture 63(2).
        """
        blue, green, red = (cv2.extractChannel(self.bgr, channel) for channel in range(3))
        plants = cv2.addWeighted(green, 15.0, red, -12.0, 0.0, dtype=cv2.CV_16S)
        return np.asarray(cv2.addWeighted(plants, 1.0, blue, -5.0, 0.0, dst=plants, dtype=cv2.CV_16S), dtype=np.int16)

    @cached_property
    def cover(self) -> float:
        """Share of the pixels that are plant, ExG - ExR > 0; 0..1."""
        return float(np.count_nonzero(self.plantness > 0)) / self.plantness.size


def picture_of(observation: Observation) -> Picture:
    """The first picture among the media of an observation.

    Raises:
        ValueError: there is no picture, or it cannot be decoded.
    """
    for media in observation.media:
        if media.type.startswith("image/"):
            return decode(media.data)
    types = ", ".join(media.type for media in observation.media) or "none"
    raise ValueError(f"the observation has no picture; its media are: {types}")


@lru_cache(maxsize=1)  # the extractors of one Map() see the same picture one after the other
def decode(data: bytes) -> Picture:
    """Decode PPM, PNG, JPEG or whatever else OpenCV reads.

    Raises:
        ValueError: the bytes are not a picture.
    """
    try:
        bgr = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR) if data else None
    except cv2.error as error:  # a broken header; a size beyond OpenCV's limit
        raise ValueError(f"a picture of {len(data)} bytes cannot be decoded: {error.err}") from error
    if bgr is None:
        raise ValueError(
            f"{len(data)} bytes that start with {data[:8]!r} are not a picture that can be decoded; "
            "use PPM, PNG or JPEG"
        )
    return Picture(np.asarray(bgr, dtype=np.uint8))


def encode(bgr: NDArray[np.uint8], suffix: str = ".png") -> bytes:
    """Bytes of a picture, uint8 [height, width, 3], in the format of a file's suffix: ".png", ".ppm", ".jpg"."""
    done, data = cv2.imencode(suffix, bgr)
    if not done:
        raise ValueError(f"OpenCV cannot write {suffix} pictures")
    return bytes(data)


def laplacian_variance(grey: NDArray[np.uint8]) -> float:
    """Variance of the 3x3 Laplacian of a grey picture, uint8 [height, width]."""
    _, deviation = cv2.meanStdDev(cv2.Laplacian(grey, cv2.CV_16S))
    return float(deviation[0, 0] ** 2)


def shrink(values: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Area average of float32 [h, w] down to [height, width]."""
    return np.asarray(cv2.resize(values, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)


def rotate(values: NDArray[np.float32], degrees: float, outside: float) -> NDArray[np.float32]:
    """Turn float32 [h, w] about its centre, counter-clockwise, on a square that holds all of it.

    Args:
        outside: Value of what was not in the picture.
    """
    height, width = values.shape
    side = int(np.ceil(np.hypot(height, width)))
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, 1.0)
    turn[:, 2] += ((side - width) / 2, (side - height) / 2)
    return np.asarray(
        cv2.warpAffine(values, turn, (side, side), flags=cv2.INTER_LINEAR, borderValue=outside), dtype=np.float32
    )
