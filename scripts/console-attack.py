"""Attacks a session's console with bad clients: ADDRESS:PORT SECONDS [PID] [--calm].

A thousand connections stay silent, and as many are opened again and again. Others send requests a
letter at a time, garbage, or endless requests whose answers they do not read. Pages send more than
they may, read a byte a second of their pictures, or read nothing. Beside them a good page views both
pictures and answers each. Its pictures and longest wait are printed as JSON, with the most memory
and threads of the process PID. With --calm there is only the good page.
"""

import base64
import json
import os
import selectors
import socket
import struct
import sys
import threading
import time

host, port = sys.argv[1].rsplit(":", 1)
place = (host, int(port))
ends = time.monotonic() + float(sys.argv[2])
pid = sys.argv[3] if len(sys.argv) > 3 else None
counts = {}


def goes_on():
    return time.monotonic() < ends


def connect(patience=5.0):
    return socket.create_connection(place, timeout=patience)


def masked(opcode, payload=b""):
    """Returns a WebSocket frame as pages send it."""
    length = len(payload)
    head = bytes([0x80 | opcode]) + (bytes([0x80 | length]) if length < 126 else bytes([0xFE]) + struct.pack(">H", length))
    return head + bytes(4) + payload


def say(stream, **wish):
    stream.sendall(masked(1, json.dumps(wish).encode()))


def page(patience=5.0):
    """Connects like a page; returns the connection and the bytes after the answer's head."""
    stream = connect(patience)
    key = base64.b64encode(os.urandom(16)).decode()
    stream.sendall(f"GET /v1/stream HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n".encode())
    data = b""
    while b"\r\n\r\n" not in data:
        more = stream.recv(4096)
        if not more:
            raise OSError("closed")
        data += more
    if not data.startswith(b"HTTP/1.1 101"):
        raise OSError(data.split(b"\r\n")[0].decode())
    return stream, data.split(b"\r\n\r\n", 1)[1]


def again(name, does, pause=0.05):
    """Repeats an attack and counts it; errors caused by the server do not end it."""

    def run():
        while goes_on():
            try:
                does()
            except (OSError, ValueError):
                pass
            counts[name] = counts.get(name, 0) + 1
            time.sleep(pause)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()


def crowd():
    held = []
    for _ in range(1000):
        if not goes_on():
            return
        held.append(connect())
    time.sleep(2)


def slowly():
    held = [connect() for _ in range(100)]
    for letter in b"GET /status HTTP/1.1\r\nHost: localhost\r\nX-Long: " + b"y" * 10000:
        if not goes_on():
            return
        alive = []
        for stream in held:
            try:
                stream.send(bytes([letter]))
                alive.append(stream)
            except OSError:
                pass
        if not alive:
            return
        held = alive
        time.sleep(0.1)


def garbage():
    with connect() as stream:
        stream.sendall(os.urandom(20000))
        stream.recv(1000)


def endlessly():
    with connect() as stream:
        stream.settimeout(1)
        while goes_on():
            stream.sendall(b"GET /status HTTP/1.1\r\nHost: localhost\r\n\r\n" * 50)


def babble():
    stream, _ = page()
    with stream:
        while goes_on():
            say(stream, do="zoom", by=0.0)


def byte_a_second():
    stream, _ = page()
    with stream:
        say(stream, do="show", slice=True, view=True)
        while goes_on() and stream.recv(1):
            time.sleep(1)


def nothing():
    stream, _ = page()
    with stream:
        say(stream, do="show", slice=True, view=True)
        while goes_on():
            time.sleep(0.5)
            # A closed connection shows when something is sent.
            stream.sendall(masked(10))


def good(result):
    """Connects before the others, views both pictures and answers them."""
    stream, data = page(30)
    say(stream, do="show", slice=True, view=True)
    began = last = time.monotonic()
    while goes_on():
        while True:
            if len(data) >= 2:
                size, start = data[1] & 127, 2
                if size == 126 and len(data) >= 4:
                    size, start = struct.unpack(">H", data[2:4])[0], 4
                elif size == 127 and len(data) >= 10:
                    size, start = struct.unpack(">Q", data[2:10])[0], 10
                elif size > 125:
                    size, start = 1 << 60, 0
                if len(data) >= start + size:
                    break
            more = stream.recv(1 << 18)
            if not more:
                raise OSError("the good page was cut off")
            data += more
        opcode, payload, data = data[0] & 15, data[start : start + size], data[start + size :]
        if opcode == 9:
            stream.sendall(masked(10, payload))
        elif opcode == 2:
            kind, sequence = payload[0], struct.unpack("<I", payload[12:16])[0]
            say(stream, do="shown", kind=kind, sequence=sequence)
            if kind == 1:
                now = time.monotonic()
                result["pictures"] += 1
                result["longest_wait_ms"] = max(result["longest_wait_ms"], (now - last) * 1e3)
                last = now
    result["pictures_a_second"] = result["pictures"] / (time.monotonic() - began)


def status_of_process():
    with open(f"/proc/{pid}/status") as lines:
        told = dict(line.split(":", 1) for line in lines)
    return int(told["VmRSS"].split()[0]) / 1e3, int(told["Threads"])


result = {"pictures": 0, "longest_wait_ms": 0.0, "resident_mb": [], "threads": []}
looks = threading.Thread(target=good, args=(result,))
looks.start()
time.sleep(1)
attack = [] if "--calm" in sys.argv else [(crowd, 1), (slowly, 1), (garbage, 4), (endlessly, 2), (babble, 2), (byte_a_second, 2), (nothing, 2)]
for does, times in attack:
    for _ in range(times):
        again(does.__name__, does)
while goes_on():
    if pid:
        memory, threads = status_of_process()
        result["resident_mb"].append(memory)
        result["threads"].append(threads)
    time.sleep(0.5)
looks.join()
for key in ("resident_mb", "threads"):
    seen = result[key]
    result[key] = {"first": seen[0], "most": max(seen)} if seen else None
result["attacks"] = counts
print(json.dumps(result))
