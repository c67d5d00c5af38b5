"""Stores the DICOM files of scripts/interop/dicom.sh in an Orthanc server over its REST interface, and
compares the files that it returns.
"""

import json
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

SECONDS = 30


def ask(url, data=None):
    # Loopback is reached without a proxy.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(urllib.request.Request(url, data=data), timeout=SECONDS) as answer:
        return answer.read()


def wait(server):
    until = time.monotonic() + SECONDS
    while True:
        try:
            return json.loads(ask(f"{server}/system"))
        except urllib.error.URLError:
            if time.monotonic() > until:
                raise SystemExit(f"no answer from {server} in {SECONDS} s")
            time.sleep(0.2)


def main():
    server, folder = sys.argv[1], Path(sys.argv[2])
    print(f"Orthanc {wait(server)['Version']}")
    files = sorted(folder.glob("*.dcm"))
    stored = {}
    for file in files:
        given = file.read_bytes()
        instance = json.loads(ask(f"{server}/instances", given))
        # A volume that is stored twice is one instance.
        expected = "AlreadyStored" if given in stored.values() else "Success"
        assert instance["Status"] == expected, (file.name, instance)
        stored[file.name] = given
        returned = ask(f"{server}/instances/{instance['ID']}/file")
        assert returned == given, f"{file.name}: other bytes came back"
        frames = json.loads(ask(f"{server}/instances/{instance['ID']}/frames"))
        print(f"{file.name}: stored, {len(frames)} frames, the same bytes back")
    patients = json.loads(ask(f"{server}/patients?expand"))
    named = [p for p in patients if p["MainDicomTags"].get("PatientID") == "4711"]
    assert len(named) == 1, patients
    # Each recording is a study, which contains its sweep and its volume.
    assert len(named[0]["Studies"]) == 2, named
    print("sweep and volume are two series of one study")


main()
