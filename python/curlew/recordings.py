"""Recordings: frames and their headers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, Optional

import numpy as np
from astropy.io import fits

from . import _fits


@dataclass(frozen=True)
class Recording:
    """Frames of a recording, or of anybody's FITS cube."""

    #: [frames, rows, cols] in the file's own type; 8 or 16 bits unsigned where Curlew wrote it; ADU
    frames: np.ndarray
    #: [frames], the camera's frame number; a gap is a frame that is missing
    sequence: np.ndarray
    #: [frames] ns, the camera's own clock; 0: unknown
    camera_ns: np.ndarray
    #: [frames] ns, UTC since 1970 at receipt; 0: unknown
    received_ns: np.ndarray
    #: [frames], bits: 1 incomplete, 2 late, 4 saturated, 8 gap before
    status: np.ndarray
    #: keys of the header: PITCH_M, WAVELEN …
    optics: Dict[str, Any]
    #: structured array of the table TRUTH of simulated frames; None: there is none
    truth: Optional[np.ndarray]

    def __len__(self) -> int:
        return len(self.frames)


def _column(rows: Optional[np.ndarray], name: str, missing: np.ndarray) -> np.ndarray:
    """Fills up what a recording that was cut off lacks."""
    values = missing.copy()
    if rows is not None and name in rows.dtype.names:
        n = min(len(rows), len(values))
        values[:n] = rows[name][:n]
        if name == "SEQUENCE" and n > 0:
            values[n:] = values[n - 1] + 1 + np.arange(len(values) - n)
    return values


def read_recording(path: str) -> Recording:
    """Reads a recording (`.fits`, `.fits.fz`) into memory.

    The table FRAMES may be short or missing: the sequence then counts on and times are 0. Raises
    OSError if the file cannot be read and ValueError if it holds no frames.
    """
    with fits.open(path, memmap=False) as file:
        image = file[0] if file[0].header["NAXIS"] > 0 else (file[1] if len(file) > 1 else file[0])
        if not image.is_image or image.data is None or image.data.ndim not in (2, 3):
            raise ValueError(f"{path} holds no frames [frames, rows, cols]")
        frames = _fits.native(image.data)
        frames = frames if frames.ndim == 3 else frames[np.newaxis]
        rows = _fits.table(file["FRAMES"]) if "FRAMES" in file else None
        truth = _fits.table(file["TRUTH"]) if "TRUTH" in file else None
        optics = _fits.optics(image.header)
    n = len(frames)
    zeros = np.zeros(n, np.int64)
    return Recording(
        frames=frames, sequence=_column(rows, "SEQUENCE", np.arange(n, dtype=np.int64)),
        camera_ns=_column(rows, "CAMERA_NS", zeros), received_ns=_column(rows, "RECEIVED_NS", zeros),
        status=_column(rows, "STATUS", np.zeros(n, np.int32)), optics=optics, truth=truth)
