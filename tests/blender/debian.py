# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender with its window on a machine that has none: Debian's, in a folder of its own.

mmdebstrap unpacks Debian's package and what a window needs into a folder, which
is used by chroot: the machine's own packages stay as they are (but for
mmdebstrap itself), nothing is mounted, and any Debian will do as the host. The
mirror is the one that apt uses here. It takes about a minute and 1.5 GB, and is
kept, so that the next run finds it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import subprocess
from pathlib import Path

SUITE = "sid"  # the only one whose Blender is new enough
BLENDER = "blender python3-numpy python3-openvdb python3-cattr python3-requests python3-zstandard"
WINDOW = "xvfb xauth x11-apps xdotool imagemagick libegl1 libegl-mesa0 libglx-mesa0 libgl1-mesa-dri"
OPTIONS = (  # mirrors may be frozen in time
    'Acquire::Check-Valid-Until "false"',
    'Acquire::Check-Date "false"',
    'Acquire::Retries "3"',
    'APT::Install-Recommends "false"',
)


class Unavailable(Exception):
    """Why there is no Blender to be had here, in a sentence."""


def folder() -> Path:
    """Where it is kept."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache, "leapray", f"blender-{SUITE}")


def install() -> Path:
    """The root folder of a Debian with Blender, made where there is none; raises Unavailable."""
    target = folder()
    target.parent.mkdir(parents=True, exist_ok=True)
    with open(target.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if (target / "usr/bin/blender").exists():
            return target
        if os.geteuid() != 0 or not shutil.which("apt-get"):
            raise Unavailable("a Blender can be installed by root on Debian only; name one")
        part = target.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)
        make(part)
        part.rename(target)
    return target


def make(root: Path) -> None:
    """Unpack Debian with Blender into a new folder."""
    with contextlib.suppress(Unavailable):  # one of several sources may be out of reach
        call("apt-get", "update", "-qq")
    source = mirror()
    if not shutil.which("mmdebstrap"):
        call("apt-get", "install", "-y", "-qq", "--no-install-recommends", "mmdebstrap")
    packages = ",".join((BLENDER + " " + WINDOW).split())
    options = [f"--aptopt={option}" for option in OPTIONS]
    base = ["mmdebstrap", "--quiet", "--mode=root", "--variant=minbase", f"--include={packages}"]
    call(*base, *options, SUITE, str(root), source)


def mirror() -> str:
    """The address of the mirror that apt uses for Debian itself."""
    listing = call("apt-get", "indextargets", "--format", "$(RELEASE) $(REPO_URI) $(LABEL)")
    for line in listing.splitlines():
        release, address, *label = line.split()
        if label == ["Debian"] and not release.endswith(("-security", "-updates", "-backports")):
            return address
    raise Unavailable("apt knows no mirror of Debian here")


def call(*command: str) -> str:
    """Run a command; returns what it printed, raises Unavailable with its last words."""
    path = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"  # not every root has them
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive", "PATH": path}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        words = done.stderr.strip().splitlines()[-5:]
        raise Unavailable(f"{command[0]} failed: {' / '.join(words)}")
    return done.stdout
