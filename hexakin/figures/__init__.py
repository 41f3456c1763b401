"""Drawings on axes that the caller gives, in one style.

Positions are given in metres and shown in millimetres. Only what a drawing needs is computed here.
"""

from hexakin.figures.charts import bar_effects, box_groups, draw_boxes, draw_sweep, heat_map
from hexakin.figures.diagrams import draw_gait, draw_joint_angles, flow_chart, plot_leg_angles
from hexakin.figures.region_charts import draw_forces, draw_regions, draw_samples
from hexakin.figures.robot_3d import (
    axes_3d,
    draw_frame,
    draw_plan,
    draw_plane,
    draw_robot,
    draw_skeleton,
    draw_terrain,
    draw_wireframe,
    set_equal_3d,
)
from hexakin.figures.style import (
    BLUE,
    CONTROLLED,
    ENGINE_COLOURS,
    GREEN,
    GREY,
    LEG_COLOURS,
    MM,
    ORANGE,
    PURPLE,
    RED,
    SIMPLE,
    STYLE,
    save_pdf,
    use_style,
)

__all__ = [
    "BLUE", "CONTROLLED", "ENGINE_COLOURS", "GREEN", "GREY", "LEG_COLOURS", "MM", "ORANGE", "PURPLE", "RED", "SIMPLE",
    "STYLE", "axes_3d", "bar_effects", "box_groups", "draw_boxes", "draw_forces", "draw_frame", "draw_gait",
    "draw_joint_angles", "draw_plan", "draw_plane", "draw_regions", "draw_robot", "draw_samples", "draw_skeleton",
    "draw_sweep", "draw_terrain", "draw_wireframe", "flow_chart", "heat_map", "plot_leg_angles", "save_pdf",
    "set_equal_3d", "use_style",
]  # fmt: skip
