#!/usr/bin/env python3
"""Downloads a file of a vehicle by MAVSDK's FTP client, in bursts and without, and prints how long each took.

    mavsdk_files.py PORT PATH FOLDER

The vehicle sends to 127.0.0.1:PORT, such as `px4-sim --link udpout:127.0.0.1:14540 --files DIR`.
"""
import os
import sys
import threading
import time
from importlib import import_module
from pathlib import Path

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk

files = import_module("mavsdk.plugins.ftp.ftp")


def download(ftp, path, folder, burst):
    local = Path(folder) / Path(path).name
    local.unlink(missing_ok=True)
    ended, results = threading.Event(), []

    def progress(result, *_):
        if result != files.FtpResult.NEXT:
            results.append(result)
            ended.set()

    begun = time.monotonic()
    ftp.download_async(path, folder, burst, progress)
    assert ended.wait(120), "it does not end"
    took = time.monotonic() - begun
    assert results == [files.FtpResult.SUCCESS], results
    return local.stat().st_size, took


def main():
    port, path, folder = sys.argv[1:]
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}") == ConnectionResult.SUCCESS
    system = mavsdk.first_autopilot(15.0)
    assert system, "no vehicle"
    ftp = files.Ftp(system)
    for burst in (True, True, True, False):
        size, took = download(ftp, path, folder, burst)
        print(f"{'bursts' if burst else 'single reads'}: {size} bytes in {took:.2f} s", flush=True)
    # Its threads do not end by themselves while callbacks wait.
    os._exit(0)


main()
