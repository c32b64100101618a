# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans what to model and how finely: the coarsest model within the permitted error."""
