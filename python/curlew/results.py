"""Results files: what `curlew replay --out` found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict

import numpy as np
from astropy.io import fits

from . import _fits


@dataclass(frozen=True)
class Results:
    """What was found in every frame. Tables are structured arrays with the columns of docs/files.md."""

    #: [frames]: FRAME SEQUENCE CAMERA_NS RECEIVED_NS STATUS N_VALID N_VORTICES OVERFLOW
    frames: np.ndarray
    #: [vortices of all frames]: FRAME X Y CHARGE CIRCULATION SIGNIFICANCE … TRACK …
    vortices: np.ndarray
    #: [holes of all frames]: FRAME HOLE CIRCULATION X Y ONE_SUBLATTICE
    holes: np.ndarray
    #: [frames], one column a stage, µs
    latency: np.ndarray
    #: the images that were saved, by name: SLOPES [frames, 2, rows, cols], PHASE [frames, rows, cols] …
    #: NaN where there is no value
    images: Dict[str, np.ndarray]
    #: {"SLOPES": "rad", "VORTICES.CIRCULATION": "rad", …}; what is missing has no unit, or pitches
    units: Dict[str, str]

    def __len__(self) -> int:
        return len(self.frames)

    def vortices_of(self, frame: int) -> np.ndarray:
        """Returns the vortices of one frame, by its number in FRAME."""
        found = self.vortices["FRAME"]
        return self.vortices[np.searchsorted(found, frame):np.searchsorted(found, frame, "right")]

    def tracks(self) -> Dict[int, np.ndarray]:
        """Returns {track number: its vortices, in the order of the frames}. Vortices that belong to
        no track (-1) are left out."""
        tracked = self.vortices[self.vortices["TRACK"] >= 0]
        tracked = tracked[np.argsort(tracked["TRACK"], kind="stable")]
        numbers, starts = np.unique(tracked["TRACK"], return_index=True)
        return dict(zip(numbers.tolist(), np.split(tracked, starts[1:])))


def read_results(path: str) -> Results:
    """Reads a results file. Raises OSError if it cannot be read and ValueError if it is none."""
    with fits.open(path, memmap=False) as file:
        _fits.check_content(path, file[0].header, "CURLEW RESULTS", "replay --out")
        tables = {hdu.name: hdu for hdu in file if isinstance(hdu, fits.BinTableHDU)}
        images = {hdu.name: hdu for hdu in file[1:] if hdu.name not in tables}
        units = {name: hdu.header["BUNIT"] for name, hdu in images.items() if "BUNIT" in hdu.header}
        for hdu in tables.values():
            units.update(_fits.units(hdu))
        return Results(
            frames=_fits.table(tables["FRAMES"]), vortices=_fits.table(tables["VORTICES"]),
            holes=_fits.table(tables["HOLES"]), latency=_fits.table(tables["LATENCY"]),
            images={name: _fits.native(hdu.data) for name, hdu in images.items()
                    if hdu.data is not None},
            units=units)
