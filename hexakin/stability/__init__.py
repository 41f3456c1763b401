"""Support polygon, zero-moment point, stability margins and the support region (A(32)-(33) and the literature)."""

from hexakin.stability.polygon import centroid, margin, polygon_margins, support_polygon
from hexakin.stability.time_series import ZMP, StabilitySeries, series, static_margin, zero_moment_point, zmp

__all__ = [
    "ZMP", "StabilitySeries", "centroid", "margin", "polygon_margins", "series", "static_margin", "support_polygon",
    "zero_moment_point", "zmp",
]  # fmt: skip
