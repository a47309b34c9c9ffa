"""Curlew's files and live streams as numpy arrays.

>>> import curlew
>>> results = curlew.read_results("results.fits")
>>> results.images["SLOPES"].shape            # [frames, 2, rows, cols], rad a pitch, NaN: missing
>>> results.vortices["CIRCULATION"].max()     # rad
>>> with curlew.Stream("curlew_slopes") as stream:
...     while stream.wait(timeout_s=1.0):
...         x, y = curlew.side_by_side(stream.read().data)

Arrays are [row, col]; x is the column and y the row. docs/python.md tells more, and docs/files.md
every column, key and unit.
"""

from .recordings import Recording, read_recording
from .results import Results, read_results
from .sensors import Sensor, read_sensor
from .streams import (
    VORTEX_COLUMNS, Stream, StreamError, StreamImage, side_by_side, stream_folder, vortices_of)

__all__ = [
    "Recording", "Results", "Sensor", "Stream", "StreamError", "StreamImage", "VORTEX_COLUMNS",
    "read_recording", "read_results", "read_sensor", "side_by_side", "stream_folder", "vortices_of",
]
