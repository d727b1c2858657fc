"""MuJoCo, loaded whatever ``MUJOCO_GL`` says: only drawing needs what it names.

``import mujoco`` itself fails where that names nothing, or a library that is not there.
"""

from __future__ import annotations

import os

try:
    import mujoco
except Exception:  # each backend fails in its own way, from RuntimeError to AttributeError
    _asked = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        import mujoco  # noqa: F401
    finally:
        if _asked is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = _asked
