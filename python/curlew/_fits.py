"""What all readers of FITS files share."""

from __future__ import annotations

from typing import Any, Dict

import numpy as np
from astropy.io import fits

#: Keys of recordings and sensor files, with their units in docs/files.md. Missing ones are unknown.
OPTICS_KEYS = (
    "PITCH_M", "FOCAL_M", "PIXEL_M", "WAVELEN", "MAGNIF", "PARITY", "EPERADU", "RDNOISE", "SATURATE",
    "BITDEPTH", "OFFSETX", "OFFSETY", "XBINNING", "YBINNING")


def native(array: np.ndarray) -> np.ndarray:
    """Returns the array in this machine's byte order, which numba, torch and others demand."""
    return np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))


def table(hdu: fits.BinTableHDU) -> np.ndarray:
    """Returns a table as a structured array [rows], with the columns' own names."""
    columns = {column.name: native(np.asarray(hdu.data[column.name])) for column in hdu.columns}
    rows = np.empty(len(hdu.data), [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    return rows


def units(hdu: fits.BinTableHDU) -> Dict[str, str]:
    """Returns {"TABLE.COLUMN": unit}; columns without a unit are left out."""
    return {f"{hdu.name}.{column.name}": column.unit for column in hdu.columns if column.unit}


def optics(header: fits.Header) -> Dict[str, Any]:
    """Returns those of OPTICS_KEYS that the header knows."""
    return {key: header[key] for key in OPTICS_KEYS if header.get(key) is not None}


def check_content(path: str, header: fits.Header, content: str, maker: str) -> None:
    """Raises ValueError if the file is none of the wanted kind."""
    if header.get("CONTENT") != content:
        raise ValueError(f"{path} is no {content.lower()} file; 'curlew {maker}' makes one")
