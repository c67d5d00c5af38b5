"""Measures the cost of hidden pages to a session: ADDRESS:PORT PID SECONDS.

Prints the CPU time of the process and of the thread that serves pages, with none and with three.
"""

import base64
import os
import socket
import sys
import threading
import time

host, port = sys.argv[1].rsplit(":", 1)
pid, seconds = sys.argv[2], float(sys.argv[3])
TICKS = os.sysconf("SC_CLK_TCK")


def cpu_s(stat):
    with open(stat) as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def thread():
    for task in os.listdir(f"/proc/{pid}/task"):
        with open(f"/proc/{pid}/task/{task}/comm") as comm:
            if comm.read().strip() == "status":
                return f"/proc/{pid}/task/{task}/stat"
    sys.exit("there is no thread that serves pages")


def page():
    stream = socket.create_connection((host, int(port)))
    key = base64.b64encode(os.urandom(16)).decode()
    stream.sendall(f"GET /v1/stream HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n".encode())

    def reads():
        while stream.recv(1 << 16):
            # Answers pings, as browsers do by themselves.
            stream.sendall(bytes([0x8A, 0x80, 0, 0, 0, 0]))

    threading.Thread(target=reads, daemon=True).start()


serving = thread()
for pages in (0, 3):
    if pages:
        for _ in range(pages):
            page()
        time.sleep(1)
    before = cpu_s(f"/proc/{pid}/stat"), cpu_s(serving)
    time.sleep(seconds)
    whole, own = (100 * (after - before) / seconds for after, before in zip((cpu_s(f"/proc/{pid}/stat"), cpu_s(serving)), before))
    print(f"{pages} pages that look at nothing: the process {whole:.1f} % of a core, serving them {own:.2f} %", flush=True)
