# SPDX-License-Identifier: GPL-3.0-or-later
"""What to model and how finely: the least that keeps the error under a share of a pixel."""
