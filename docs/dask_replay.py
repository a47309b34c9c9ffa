#!/usr/bin/env python3
"""A night by Dask: dask_replay.py SCHEDULER SHARDS RESULTS.fits curlew replay NIGHT*.fits --sensor SENSOR.fits …

SCHEDULER is the address of a scheduler, as tcp://head:8786, or `--local N` for N workers on this machine. A
shard that fails, because a worker died or a disk was full, is given to the workers again, three times in all.
The files must be on a file system that all workers share, under the same names.
"""
import os
import subprocess
import sys

from distributed import Client, LocalCluster, as_completed


def replay(part, command, out, folder):
    run = subprocess.run([*command, "--out", out, "--shard", part], cwd=folder, capture_output=True, text=True)
    if run.returncode != 0:
        raise RuntimeError(run.stderr.strip() or f"shard {part} was ended by signal {-run.returncode}")
    return run.stdout.strip()


def main(arguments):
    local = arguments[0] == "--local"
    where = (LocalCluster(n_workers=int(arguments[1]), threads_per_worker=1, dashboard_address=None)
             if local else arguments[0])
    shards, out, *command = arguments[2 if local else 1:]
    with Client(where) as client:
        parts = [f"{shard}/{shards}" for shard in range(1, int(shards) + 1)]
        done = client.map(replay, parts, command=command, out=out, folder=os.getcwd(), retries=2, pure=False)
        for shard in as_completed(done):
            print(shard.result())
        print(client.submit(replay, f"all/{shards}", command, out, os.getcwd(), pure=False).result())


if __name__ == "__main__":
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    main(sys.argv[1:])
