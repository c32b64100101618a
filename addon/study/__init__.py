# SPDX-License-Identifier: GPL-3.0-or-later
"""Studies: LeapRay compared with Cycles, and traversers with each other."""
