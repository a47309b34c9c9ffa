"""Curlew's stages, compiled. Use curlew.Pipeline."""

from typing import Dict, Optional, Tuple

import numpy as np

class FrameResults:
    """What Curlew found in a frame.

    Arrays are read-only views on the pipeline's own memory, without a copy: the next process() of
    the same pipeline fills them anew, whichever FrameResults they came from. Copy what shall stay.
    Maps of lenslets are [rows, cols]; where `valid` is 0, slopes and phase are 0 and mean nothing.
    """

    #: [rows, cols] float32, rad a pitch: slopes along the lenslet axes
    slopes_x: np.ndarray
    slopes_y: np.ndarray
    #: [rows, cols] float32, rad² a pitch²: their variances by photon and read noise
    variance_x: np.ndarray
    variance_y: np.ndarray
    #: [rows, cols] uint8, 1: the lenslet has a slope
    valid: np.ndarray
    #: [rows, cols] float32, ADU: light above the threshold
    flux: np.ndarray
    #: [rows, cols] float32, px: places of the spots
    spot_x_px: np.ndarray
    spot_y_px: np.ndarray
    #: [rows, cols] float32, rad: least-squares phase at the lenslets' centres, mean 0 an island
    phase: np.ndarray
    #: [rows, cols] float32, rad: with what the vortices add; [0, 0] without [split] hidden_phase
    whole_phase: np.ndarray
    #: [rows, cols] int32: the connected part of the phase, 0 the largest; -1: no slope
    island: np.ndarray
    #: [rows, cols] float32, rad a pitch: what least squares leaves of the slopes
    solenoidal_x: np.ndarray
    solenoidal_y: np.ndarray
    #: [rows-1, cols-1] float32, rad: circulation of each cell, and uint8, 1: it has one
    circulation: np.ndarray
    circulation_valid: np.ndarray
    #: [vortices] structured: X Y (lenslet units) CHARGE CIRCULATION (rad) SIGNIFICANCE PROBABILITY
    #: VAR_X VAR_Y COV_XY (pitches²) VX VY (pitches a second) FLAGS TRACK
    vortices: np.ndarray
    #: number of the frame, from 0
    frame: int
    #: bits of STATUS, docs/files.md
    status: int
    n_valid: int
    n_lost: int
    n_islands: int
    #: µs by stage, and "total"
    latency_us: Dict[str, float]

    def zernike(self) -> Tuple[np.ndarray, np.ndarray]:
        """Returns coefficients and standard errors, each [modes] float64, rad rms, from Noll 2 on;
        NaN where the lenslets do not tell the modes apart. These are copies."""

    def wavefront(self) -> Dict[str, float]:
        """Returns rms_rad, rms_nm, pv_rad, pv_nm and strehl (Maréchal) of the phase less its best
        plane; NaN where fewer than three lenslets have a slope."""

class Pipeline:
    #: lenslets (rows, cols)
    shape: Tuple[int, int]
    #: pixels (rows, cols) of a frame
    frame_shape: Tuple[int, int]
    #: uint8 or uint16, native byte order
    dtype: np.dtype

    def __init__(self, sensor: str, config: str) -> None: ...
    def process(self, frame: np.ndarray, sequence: Optional[int] = None, camera_ns: int = 0,
                received_ns: int = 0) -> FrameResults:
        """Takes a frame through all stages. The pixels are copied once; the GIL is released.

        frame: [rows, cols] of frame_shape and dtype, rows one after the other in memory.
        sequence: the camera's number; by default one more than before. camera_ns, received_ns:
        times, by which tracks have velocities a second.

        Raises TypeError or ValueError for another dtype, shape or layout, ValueError if the
        pipeline is closed, and RuntimeError if another thread is in process() of this pipeline.
        """
    def close(self) -> None:
        """Lets the memory go, as soon as no results or arrays refer to it."""
