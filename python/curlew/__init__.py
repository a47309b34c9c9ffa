"""Curlew's files and live streams as numpy arrays.

>>> import curlew
>>> results = curlew.read_results("results.fits")
>>> results.images["SLOPES"].shape            # [frames, 2, rows, cols], rad a pitch, NaN: missing
>>> results.vortices["CIRCULATION"].max()     # rad
>>> with curlew.Stream("curlew_slopes") as stream:
...     while stream.wait(timeout_s=1.0):
...         x, y = curlew.side_by_side(stream.read().data)

>>> with curlew.Pipeline("sensor.fits", {"track": {"enabled": True}}) as pipeline:
...     slopes_x = pipeline.process(frame).slopes_x          # [rows, cols], rad a pitch

Arrays are [row, col]; x is the column and y the row. docs/python.md tells more, and docs/files.md
every column, key and unit.
"""

from .recordings import Recording, read_recording
from .results import Results, read_results
from .sensors import Sensor, read_sensor
from .streams import (
    VORTEX_COLUMNS, Stream, StreamError, StreamImage, side_by_side, stream_folder, vortices_of)

try:
    from .pipeline import FrameResults, Pipeline, calibrate, simulate
except ImportError as error:  # files and streams need nothing but Python
    _missing = str(error)

    def __getattr__(name: str) -> object:
        if name in ("FrameResults", "Pipeline", "calibrate", "simulate"):
            raise ImportError(
                f"curlew.{name} needs the compiled module, which is in the package python3-curlew "
                f"and in build/release/python: {_missing}")
        raise AttributeError(f"module 'curlew' has no attribute '{name}'")

__all__ = [
    "Recording", "Results", "Sensor", "Stream", "StreamError", "StreamImage", "VORTEX_COLUMNS",
    "calibrate", "read_recording", "read_results", "read_sensor", "side_by_side", "simulate",
    "stream_folder", "vortices_of",
]
if "_missing" not in globals():
    __all__ += ["FrameResults", "Pipeline"]
