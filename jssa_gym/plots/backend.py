"""matplotlib and PyAV, which come with the extra ``plots``: whether they are there, and files of pixels."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import MissingExtraError, how_to_install
from jssa_gym.plots.style import draw_without_display
from jssa_gym.storage import whole_file


def require(film: bool = False) -> None:
    """Find out before long work whether figures, and films, can be made.

    Raises:
        MissingExtraError: matplotlib or PyAV is not installed.
    """
    for module, what in (("matplotlib", "figures"), ("av", "films"))[: 2 if film else 1]:
        if importlib.util.find_spec(module) is None:
            raise MissingExtraError(f"{what} need the extra 'plots': {how_to_install('plots')}")


def write_png(file: IO[bytes], pixels: NDArray[np.uint8]) -> None:
    """Write a picture of shape (height, width, 3).

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    draw_without_display()
    from matplotlib.image import imsave

    imsave(cast(BinaryIO, file), pixels, format="png")


def write_film(path: str | Path, frames: Iterator[NDArray[np.uint8]], rate: int) -> None:
    """Write frames as H.264 into an MP4; the file appears when it is complete.

    Args:
        path: The file.
        frames: Pictures of one shape with even sides, (height, width, 3).
        rate: Frames a second.

    Raises:
        MissingExtraError: PyAV is not installed.
        StorageError: The file cannot be written.
    """
    try:
        import av
    except ImportError as error:
        raise MissingExtraError(f"films need the extra 'plots': {how_to_install('plots')}") from error
    with whole_file(Path(path)) as file, av.open(file, "w", format="mp4") as container:
        stream: Any = container.add_stream("h264", rate=rate)
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "22", "preset": "fast"}
        for k, picture in enumerate(frames):
            if k == 0:
                stream.height, stream.width = picture.shape[:2]
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
