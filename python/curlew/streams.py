"""Live images in shared memory, of Curlew and of any program that speaks ImageStreamIO 2.00."""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import struct
import time
from typing import Any, Dict, NamedTuple, Optional, Tuple, Union

import numpy as np

_METADATA_BYTES = 384
_KEYWORD_BYTES = 128
_SEM_BYTES = 32
_TRACE_BYTES = 64
_TYPES = {1: np.uint8, 2: np.int8, 3: np.uint16, 4: np.int16, 5: np.uint32, 6: np.int32, 7: np.uint64,
          8: np.int64, 9: np.float32, 10: np.float64}
_NS_PER_S = 1_000_000_000

#: Columns of the stream of vortices. Places are in lenslet units, CIRCULATION in rad, VX and VY in
#: pitches a second.
VORTEX_COLUMNS = ("X", "Y", "CHARGE", "CIRCULATION", "SIGNIFICANCE", "PROBABILITY", "VAR_X", "VAR_Y",
                  "COV_XY", "VX", "VY", "FLAGS", "TRACK")


class StreamError(Exception):
    """The stream cannot be read, and why."""


class _Timespec(ctypes.Structure):
    _fields_ = [("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long)]


_libc = ctypes.CDLL(None, use_errno=True)


def _padded(n: int) -> int:
    return (n + 7) // 8 * 8


def stream_folder() -> str:
    """Returns the folder of streams: $MILK_SHM_DIR, else /milk/shm where that exists, else /tmp."""
    return os.environ.get("MILK_SHM_DIR") or ("/milk/shm" if os.path.isdir("/milk/shm") else "/tmp")


def side_by_side(image: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Returns the x half and the y half, each [rows, cols], of slopes or mask [rows, 2·cols]. They
    are views."""
    cols = image.shape[1] // 2
    return image[:, :cols], image[:, cols:]


class StreamImage(NamedTuple):
    """One update of a stream, copied out of it."""

    #: the image, [rows, cols]
    data: np.ndarray
    #: number of the update, which grows by 1
    count: int
    #: acquisition, UTC ns since 1970; 0: unknown
    acquired_ns: int
    #: when the writer wrote it, UTC ns since 1970
    written_ns: int
    keywords: Dict[str, Union[int, float, str]]


class Stream:
    """A stream of images in shared memory.

    `data` is a view without a copy, which changes under the reader's hands; `read()` returns a copy
    that is of one update, and `wait()` waits for the next one. A reader that stops or dies never
    stalls the writer. Use it in a `with`, or call close(): it gives its semaphore back.
    """

    def __init__(self, name: str, folder: Optional[str] = None):
        """Opens FOLDER/NAME.im.shm. Raises StreamError if it is missing or no such stream."""
        self.name = name
        self.path = os.path.join(folder or stream_folder(), name + ".im.shm")
        try:
            file = open(self.path, "r+b")
        except OSError as error:
            raise StreamError(
                f"stream {self.path}: {error.strerror}; is its writer running, and MILK_SHM_DIR "
                "set as the writer has it?") from None
        with file:
            size = os.fstat(file.fileno()).st_size
            if size < _METADATA_BYTES:
                raise StreamError(f"stream {self.path} is too short to be a stream")
            self._memory = mmap.mmap(file.fileno(), size)
        self._lay_out(size)
        self._semaphore: Optional[int] = None
        self._seen = self.count

    def _lay_out(self, size: int) -> None:
        version = self._memory[:32].split(b"\0")[0]
        if version != b"2.00":
            raise StreamError(f"stream {self.path} has version {version!r}, only b'2.00' is read")
        naxis = self._memory[112]
        axes = struct.unpack_from("<3I", self._memory, 116)[:naxis]
        datatype = self._memory[136]
        if datatype not in _TYPES or not 1 <= naxis <= 3 or self._field("<b", 240) >= 0:
            raise StreamError(f"stream {self.path} holds no numbers in the CPU's memory")
        dtype = np.dtype(_TYPES[datatype])
        n = int(np.prod(axes, dtype=np.int64))
        self._n_semaphores = self._field("<H", 258)
        self._n_keywords = self._field("<H", 290)
        traces = self._field("<H", 260)
        self._keywords_at = _METADATA_BYTES + _padded(n * dtype.itemsize)
        self._semaphores_at = self._keywords_at + _KEYWORD_BYTES * self._n_keywords
        self._readers_at = self._semaphores_at + _SEM_BYTES * (self._n_semaphores + 1)
        expected = self._readers_at + 4 * _padded(4 * self._n_semaphores) + _TRACE_BYTES * traces
        if size != expected:
            raise StreamError(f"stream {self.path} has {size} bytes, its header needs {expected}")
        #: the image, [rows, cols], as a view that changes and cannot be written to
        self.data = np.ndarray(axes[::-1], dtype, self._memory, _METADATA_BYTES)
        self.data.flags.writeable = False

    def _field(self, layout: str, offset: int) -> int:
        return struct.unpack_from(layout, self._memory, offset)[0]

    @property
    def count(self) -> int:
        """The number of updates since the stream was made."""
        return self._field("<Q", 264)

    def _utc_ns(self, offset: int) -> int:
        seconds, ns = struct.unpack_from("<qq", self._memory, offset)
        if seconds == 0:
            return 0
        # The kernel knows how far TAI is from UTC.
        leap = round(time.clock_gettime(time.CLOCK_TAI) - time.clock_gettime(time.CLOCK_REALTIME))
        return (seconds - leap) * _NS_PER_S + ns

    @property
    def keywords(self) -> Dict[str, Union[int, float, str]]:
        """The stream's keywords: FRAME, SEQUENCE, UNIT, and COUNT or N_VALID where Curlew writes it."""
        found: Dict[str, Union[int, float, str]] = {}
        for i in range(self._n_keywords):
            at = self._keywords_at + _KEYWORD_BYTES * i
            name = self._memory[at:at + 16].split(b"\0")[0].decode("ascii", "replace")
            kind = self._memory[at + 16:at + 17]
            if kind == b"L":
                found[name] = self._field("<q", at + 24)
            elif kind == b"D":
                found[name] = self._field("<d", at + 24)
            elif kind == b"S":
                text = self._memory[at + 24:at + 40].split(b"\0")[0]
                found[name] = text.decode("ascii", "replace")
        return found

    def read(self) -> StreamImage:
        """Copies the newest image. Raises StreamError if the writer has changed it during ten
        attempts in a row, as when it died in the middle of an update."""
        for _ in range(10):
            count = self.count
            if self._memory[288] == 0:
                image = StreamImage(self.data.copy(), count, self._utc_ns(184), self._utc_ns(200),
                                    self.keywords)
                if self.count == count and self._memory[288] == 0:
                    return image
            time.sleep(50e-6)
        raise StreamError(f"stream {self.path} changes all the time; did its writer die?")

    def wait(self, timeout_s: Optional[float] = None) -> bool:
        """Waits for an update that came after the last wait(), or after the stream was opened.
        Returns False if none came in time; None waits for ever. Several updates may have come: see
        `count`."""
        until = None if timeout_s is None else time.monotonic() + timeout_s
        semaphore = self._claimed_semaphore()
        while self.count == self._seen:
            left = 0.1 if until is None else min(0.1, until - time.monotonic())
            if left <= 0.0:
                return False
            self._timed_wait(semaphore, left)  # Short waits, so that Ctrl-C is heard.
        while _libc.sem_trywait(semaphore) == 0:
            pass  # Posts of updates that are gone.
        self._seen = self.count
        return True

    def _claimed_semaphore(self) -> Any:
        if self._semaphore is None:
            for i in range(self._n_semaphores):
                owner = self._field("<i", self._readers_at + 4 * i)
                if owner <= 0 or not _is_alive(owner):
                    struct.pack_into("<i", self._memory, self._readers_at + 4 * i, os.getpid())
                    self._semaphore = i
                    break
            else:
                raise StreamError(
                    f"stream {self.path} has no free semaphore; stop one of its "
                    f"{self._n_semaphores} readers")
        return self._address(self._semaphores_at + _SEM_BYTES * self._semaphore)

    def _address(self, offset: int) -> Any:
        # A numpy view tells the address and lets the map be closed later, as ctypes' views do not.
        base = self.data.__array_interface__["data"][0] - _METADATA_BYTES
        return ctypes.c_void_p(base + offset)

    @staticmethod
    def _timed_wait(semaphore: Any, seconds: float) -> None:
        until = time.clock_gettime_ns(time.CLOCK_REALTIME) + int(seconds * 1e9)
        limit = _Timespec(until // _NS_PER_S, until % _NS_PER_S)
        if _libc.sem_timedwait(semaphore, ctypes.byref(limit)) != 0:
            error = ctypes.get_errno()
            if error not in (errno.ETIMEDOUT, errno.EINTR):
                raise StreamError(f"waiting failed: {os.strerror(error)}")

    def close(self) -> None:
        """Gives the semaphore back. `data` must not be used any more."""
        if self._semaphore is not None:
            struct.pack_into("<i", self._memory, self._readers_at + 4 * self._semaphore, -1)
            self._semaphore = None

    def __enter__(self) -> "Stream":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def vortices_of(image: StreamImage) -> np.ndarray:
    """Returns the vortices in an update of the stream of vortices: a structured array [COUNT] with
    the columns VORTEX_COLUMNS, in double."""
    rows = image.data[:int(image.keywords["COUNT"])]
    return np.ascontiguousarray(rows).view([(name, "f8") for name in VORTEX_COLUMNS])[:, 0]
