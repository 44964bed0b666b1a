"""hdplan: motion planning for robot arms with smooth signed distances, proven against the real meshes.

    import hdplan
    scene = hdplan.load_scene("panda_cage")
    result = hdplan.plan(scene)
    print(result.certificate.text)
    result.save("motion.json")

A scene can also be made without a file:

    box = hdplan.Box([0.1, 0.1, 0.6], pose=[0.6, 0.0, 0.3])
    scene = hdplan.Scene(robot="panda", obstacles=[box], start="default", goal=[0.6, -0.3, 0, -2, 0, 1.8, 0.785])

The public interface is listed in the stub file (`.pyi`) beside this module, and beside `hdplan.distance`,
`hdplan.control` and `hdplan.symbolic`; everything else may change from one version to the next. All input is checked,
and refused with an `InputError` of one line. All results can be pickled.

Names are imported on first use, so that `import hdplan` is fast. Everything may be called from several threads at once,
also on shared objects, with the same results.
"""

from __future__ import annotations

import os

# In a checkout planner/, distance/, scenes/ and cli.py lie at its top, and are imported from there: the links beside
# this file are for type checkers, which run nothing.
_checkout = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
if os.path.isfile(os.path.join(_checkout, "hatch_build.py")):
    __path__.insert(0, _checkout)

from hdplan.scenes.lazy_imports import lazy_names  # noqa: E402

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__, "__version__")
