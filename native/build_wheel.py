# SPDX-License-Identifier: GPL-3.0-or-later
"""What hatchling asks while it makes the wheel: compile the core, name the platform."""

import sys
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

# hatchling loads this file by its path, which leaves its folder unknown
sys.path.insert(0, str(Path(__file__).resolve().parent))
import build_core


class CustomBuildHook(BuildHookInterface):
    def initialize(self, version: str, build_data: dict) -> None:
        build_core.build(say=self.app.display_info)
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{build_core.PLATFORM}"
