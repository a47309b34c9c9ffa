"""Sensor files: what `curlew calibrate` found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, Optional, Tuple

import numpy as np
from astropy.io import fits

from . import _fits


@dataclass(frozen=True)
class Sensor:
    """A calibrated Shack-Hartmann sensor. Maps of lenslets are [rows, cols]."""

    #: keys of the header: PITCH_M, FOCAL_M, PIXEL_M, WAVELEN …
    optics: Dict[str, Any]
    #: [2] px, detector place (x, y) of lenslet (0, 0)
    origin_px: np.ndarray
    #: [2, 2] px, place on the detector = origin_px + axes_px @ (col, row)
    axes_px: np.ndarray
    #: [rows, cols] bool, whether the lenslet is lit
    valid: np.ndarray
    #: [rows, cols] px, reference spots; NaN where there is no lenslet
    ref_x_px: np.ndarray
    ref_y_px: np.ndarray
    #: [4, rows, cols] px: first column, first row, width, height
    window_px: np.ndarray
    #: [2, rows, cols], window gain along x, then y
    gain: np.ndarray
    #: [4, rows, cols], the bends of the gain (docs/files.md); None where the file has none
    bend: Optional[np.ndarray]
    #: [frame rows, frame cols] ADU; None: none was given
    dark_adu: Optional[np.ndarray]
    flat: Optional[np.ndarray]
    #: [frame rows, frame cols] bool, True: bad; None: there are none
    bad_pixel: Optional[np.ndarray]

    @property
    def shape(self) -> Tuple[int, int]:
        """Lenslets (rows, cols)."""
        return self.valid.shape[0], self.valid.shape[1]

    @property
    def slope_rad_per_px(self) -> float:
        """The slope, rad a pitch, of a spot that is displaced by one pixel: 2π·w·p/(λ·f·m)."""
        o = self.optics
        return float(2.0 * np.pi * o["PITCH_M"] * o["PIXEL_M"]
                     / (o["WAVELEN"] * o["FOCAL_M"] * o.get("MAGNIF", 1.0)))

    def pixel_from_lenslet(self, col: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Returns the places (x, y) in px, [2, …], of places in lenslet units."""
        return np.stack([
            self.origin_px[axis] + self.axes_px[axis, 0] * np.asarray(col)
            + self.axes_px[axis, 1] * np.asarray(row) for axis in (0, 1)])


def read_sensor(path: str) -> Sensor:
    """Reads a sensor file. Raises OSError if it cannot be read and ValueError if it is none."""
    with fits.open(path, memmap=False) as file:
        header = file[0].header
        _fits.check_content(path, header, "CURLEW SENSOR", "calibrate")

        def image(name: str) -> Optional[np.ndarray]:
            return _fits.native(file[name].data) if name in file else None

        bad = image("BADPIX")
        return Sensor(
            optics=_fits.optics(header),
            origin_px=np.array([header["ORIGINX"], header["ORIGINY"]]),
            axes_px=np.array([[header["P11"], header["P12"]], [header["P21"], header["P22"]]]),
            valid=file["VALID"].data != 0, ref_x_px=image("REFX"), ref_y_px=image("REFY"),
            window_px=image("WINDOW"), gain=image("GAIN"), bend=image("BEND"), dark_adu=image("DARK"),
            flat=image("FLAT"), bad_pixel=None if bad is None else bad != 0)
