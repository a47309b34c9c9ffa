#!/usr/bin/python3
"""From files to figures with numpy: python_example.py RESULTS.fits RECORDING.fits SENSOR.fits

docs/python.md explains it; it is run by the tests.
"""

import sys

import numpy as np

import curlew

results = curlew.read_results(sys.argv[1])  # replay --track --save slopes,phase
recording = curlew.read_recording(sys.argv[2])
sensor = curlew.read_sensor(sys.argv[3])

# Slopes are [frames, 2, rows, cols] in rad a pitch, and NaN where a lenslet is missing.
slopes = results.images["SLOPES"]
print(f"{len(results)} frames of {sensor.shape[1]} x {sensor.shape[0]} lenslets")
print(f"slopes: {np.nanstd(slopes):.3f} rad a pitch rms, "
      f"{np.nanstd(slopes) / sensor.slope_rad_per_px:.3f} px")
print(f"missing: {np.isnan(slopes[:, 0][:, sensor.valid]).mean():.2%} of the lit lenslets")

# Vortices are rows of one structured array, and tracks are pieces of it.
for number, track in sorted(results.tracks().items()):
    print(f"track {number}: charge {int(np.median(track['CHARGE'])):+d} in {len(track)} frames from "
          f"({track['X'][0]:.2f}, {track['Y'][0]:.2f}) to ({track['X'][-1]:.2f}, {track['Y'][-1]:.2f})")

# Slopes as a vector a frame, as AOT and most control matrices have it: all x, then all y.
vectors = slopes[:, :, sensor.valid].reshape(len(results), -1)
print(f"slope vectors: {vectors.shape}")

# The pixels are those of the recording.
print(f"pixels: {recording.frames.dtype} {recording.frames.shape}, mean {recording.frames.mean():.1f} ADU")
