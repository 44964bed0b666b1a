"""Distance of a controller's barriers, and the bodies that it compares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hdplan.scenes.errors import FieldError, nearest
from hdplan.scenes.values import Checked, Choice, Number, Whole, shorten, text

BARRIER_DISTANCES = ("hdsdf", "hdsdf-boxes", "euclidean", "gdf")


@dataclass(frozen=True)
class BarrierSettings(Checked):
    """Distance of barriers, and the bodies that it compares."""

    distance: Annotated[str, Choice(BARRIER_DISTANCES)] = "hdsdf"
    """hdsdf (planes of the obstacle), hdsdf-boxes (the paper's set), euclidean (exact) or gdf."""
    gamma: Annotated[int, Whole(1, 1000)] = 2  # order of differentiability of the HD-SDF
    shaping_length: Annotated[float, Number(above=0.0, unit="m")] = 1e-3  # width of its flat spot [m]
    growth: Annotated[float, Number(0.0, 1.0, unit="m")] = 0.006  # g, by which obstacles are grown [m]
    self_growth: Annotated[float, Number(0.0, 1.0, unit="m")] = 0.005  # g of one link, where links are compared [m]
    normals: Annotated[str, text] = "box"
    """Planes of an obstacle: faces, box or sphere; of hdsdf-boxes: paper or paper-multiset."""

    def _check_whole(self) -> None:
        known = ("paper", "paper-multiset") if self.distance == "hdsdf-boxes" else ("faces", "box", "sphere")
        if self.normals not in known:
            wanted = nearest(self.normals, known)
            raise FieldError(f"{shorten(repr(self.normals))} for {self.distance}{wanted}", "normals")
