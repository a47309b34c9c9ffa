"""The pipeline in this process: the same stages as `curlew replay`, frame by frame; and `simulate`
and `calibrate`, which run the program's commands of these names."""

from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
import tempfile
from typing import Any, Dict, List, Mapping, Optional, Union

import numpy as np

from . import _native
from .recordings import Recording, read_recording
from .sensors import Sensor, read_sensor

FrameResults = _native.FrameResults
PathLike = Union[str, "os.PathLike[str]"]


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    return repr(value)


def _toml(settings: Mapping[str, Mapping[str, Any]]) -> str:
    lines = []
    for section, values in settings.items():
        lines.append(f"[{section}]")
        lines.extend(f"{key} = {_toml_value(value)}" for key, value in values.items())
    return "\n".join(lines) + "\n"


class Pipeline(_native.Pipeline):
    """Curlew's stages for the frames of one sensor.

    sensor: path of a sensor file, which `calibrate` writes.
    config: path of a configuration file (TOML), or its content as {section: {key: value}}, as
    {"track": {"enabled": True}}; packaging/curlew.toml has all of them. [pipeline] threads and cpus
    have no effect: the stages run on the thread that calls.

    close(), or the end of a `with`, lets its memory go; process() then raises ValueError. One thread
    at a time may use it, and each thread may have one of its own.

    Raises ValueError for settings, and RuntimeError for files, that cannot be used.
    """

    def __init__(self, sensor: PathLike,
                 config: Union[PathLike, Mapping[str, Mapping[str, Any]], None] = None) -> None:
        if not isinstance(config, Mapping):
            super().__init__(os.fspath(sensor), "" if config is None else os.fspath(config))
            return
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "settings.toml"
            path.write_text(_toml(config), encoding="utf-8")
            super().__init__(os.fspath(sensor), str(path))

    def __enter__(self) -> Pipeline:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _program() -> str:
    """Returns the path of the program: that of the tree in which this package was built, or that on
    the PATH. The environment's CURLEW_PROGRAM names another."""
    built = pathlib.Path(__file__).parent.parent.parent / "curlew"
    named = os.environ.get("CURLEW_PROGRAM")
    if named or built.is_file():
        return named or str(built)
    installed = shutil.which("curlew")
    if installed is None:
        raise RuntimeError("the program curlew is not on the PATH: install the package curlew, or name "
                           "the program in CURLEW_PROGRAM")
    return installed


def _run(words: List[str]) -> None:
    """Runs a command and prints what it prints. Its exit codes become exceptions."""
    done = subprocess.run([_program(), *words], capture_output=True, text=True, check=False)
    print(done.stdout, end="")
    if done.returncode == 0:
        return
    why = done.stderr.strip().split("curlew: ", 1)[-1] or f"curlew ended with {done.returncode}"
    raise (ValueError if done.returncode == 2 else RuntimeError)(why)


def _words(options: Mapping[str, Any]) -> List[str]:
    """Turns pitch_um=300 into --pitch-um=300; lists of tuples repeat the option."""
    words = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], (list, tuple, str)):
            for one in value:
                words.extend(_words({name: one}))
        elif isinstance(value, (list, tuple)):
            separator = ":" if name == "zernike" else ","
            words.append(option + "=" + separator.join(map(str, value)))
        else:
            words.append(f"{option}={value}")
    return words


def simulate(preset: str = "plane", *, out: Optional[PathLike] = None, **options: Any) -> Recording:
    """Simulates frames with their truth, as `curlew simulate` does.

    preset: plane, tilt, zernike, vortex, dipole, turbulence, chen2007.
    out: a recording to write as well.
    options: those of the command, with _ for -: frames, rows, cols, window, photons, seed, bits,
    tilt=(sx, sy) in rad a pitch, vortex=[(x, y, charge), …] in lenslet units,
    zernike=[(noll, rms_rad), …], rytov_variance, wind=[(vx, vy)] in pitches a frame …

    Returns the recording: frames [frames, rows, cols] uint16 (uint8 with bits=8), truth, optics.
    Raises ValueError for options that make no sense. What the command prints is printed.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = os.fspath(out) if out is not None else str(pathlib.Path(folder) / "simulated.fits")
        _run(["simulate", f"--preset={preset}", f"--out={path}", *_words(options)])
        return read_recording(path)


def calibrate(reference: Union[PathLike, np.ndarray], out: PathLike, *,
              dark: Union[PathLike, np.ndarray, None] = None,
              flat: Union[PathLike, np.ndarray, None] = None,
              bad_pixels: Union[PathLike, np.ndarray, None] = None, **options: Any) -> Sensor:
    """Finds the lenslets in frames of a reference beam and writes a sensor file, as `curlew
    calibrate` does.

    reference: path of a recording, or frames [rows, cols] or [frames, rows, cols], uint8 or uint16.
    out: the sensor file.
    dark, flat, bad_pixels: paths, or arrays [rows, cols] or [frames, rows, cols].
    options: those of the command, with _ for -: pitch_um, focal_mm, pixel_um, wavelength_nm,
    magnification, mirror=True, e_per_adu, read_noise_e, saturation_adu, force=True …

    Raises ValueError for options, and RuntimeError for frames, that cannot be used. What the
    command prints, with its verdict on the sensor, is printed.
    """
    with tempfile.TemporaryDirectory() as folder:

        def path_of(name: str, source: Any) -> str:
            if not isinstance(source, np.ndarray):
                return os.fspath(source)
            path = str(pathlib.Path(folder) / f"{name}.npy")
            np.save(path, source.astype("u1") if source.dtype == bool else source)
            return path

        maps: Dict[str, Any] = {"dark": dark, "flat": flat, "bad_pixels": bad_pixels}
        given = {name: path_of(name, source) for name, source in maps.items() if source is not None}
        _run(["calibrate", path_of("reference", reference),
              f"--out={os.fspath(out)}", *_words(given), *_words(options)])
    return read_sensor(os.fspath(out))
