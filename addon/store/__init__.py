# SPDX-License-Identifier: GPL-3.0-or-later
"""Caches between frames, in memory, and between runs, in files."""
