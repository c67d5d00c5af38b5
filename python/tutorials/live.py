"""A running session: its status, its pictures, and a command.

    python live.py http://127.0.0.1:9110 [TOKEN]

`sonoweave demo` starts a session without hardware.
"""

from __future__ import annotations

import itertools
import sys

from sonoweave import live


def main(address: str, token: str | None = None) -> None:
    """Watch a session, and freeze it for a moment."""
    session = live.connect(address, token=token)
    status = session.wait(30, used=10)
    print(f"{status['frames']['used']} of {status['frames']['total']} frames used")

    for picture in itertools.islice(session.stream(view=False), 3):
        print(f"frame {picture.frame}: {picture.size[0]}×{picture.size[1]} pixels")

    session.do("freeze", on=True)
    print("frozen")
    session.do("freeze", on=False)
    try:
        session.do("dance")
    except live.CommandRefused as refused:
        print(f"refused: {refused}")


if __name__ == "__main__":
    main(*sys.argv[1:])
