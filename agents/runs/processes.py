"""How commands are asked to stop, on every system."""

from __future__ import annotations

import signal

STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))
"""Signals that ask a command to stop; SIGBREAK is what Windows has where others have SIGTERM."""
