"""Public names with their types, made of the table in __init__.py by ``make generated``; not to be edited."""
# ruff: noqa

from hexakin.installation import __version__ as __version__
from hexakin.robot.model import Robot as Robot
from hexakin.robot.file import load_robot as load_robot
from hexakin.kinematics.forward import forward_kinematics as forward_kinematics
from hexakin.kinematics.inverse import inverse_kinematics as inverse_kinematics
from hexakin.kinematics.forward import jacobian as jacobian
from hexakin.control.interface import Command as Command
from hexakin.control.interface import ControlRun as ControlRun
from hexakin.control.interface import Controller as Controller
from hexakin.control.interface import Observation as Observation
from hexakin.control.posture import PostureController as PostureController
from hexakin.simulation.closed_loop import simulate as simulate
from hexakin.walking.planner import plan_walk as plan_walk
from hexakin.motion.walk_plan import WalkPlan as WalkPlan
from hexakin.motion.recording import Recording as Recording
from hexakin.motion.recording import load_recording as load_recording
from hexakin import animation as animation
from hexakin.motion import clearance as clearance
from hexakin import contact as contact
from hexakin import dynamics as dynamics
from hexakin import engines as engines
from hexakin import exceptions as exceptions
from hexakin.papers import scenarios as experiments
from hexakin import feasibility as feasibility
from hexakin import figures as figures
from hexakin.walking import gait as gait
from hexakin import kinematics as kinematics
from hexakin.motion import measures as measures
from hexakin.robot import mjcf as mjcf
from hexakin.papers import statements as paper
from hexakin.control import posture as posture
from hexakin.control import standing_up as rising
from hexakin.figures import sliders as sliders
from hexakin import stability as stability
from hexakin.stability import stance as stance
from hexakin.control import steering as steering
from hexakin.papers import studies as studies
from hexakin import study as study
from hexakin.stability import support_region as support_region
from hexakin.walking import swing as swing
from hexakin import symbolic as symbolic
from hexakin import terrain as terrain
from hexakin import transforms as transforms
from hexakin.robot import urdf as urdf
from hexakin.walking import planner as walker

PUBLIC: dict[str, str]
__all__ = [
    "__version__",
    "Robot",
    "load_robot",
    "forward_kinematics",
    "inverse_kinematics",
    "jacobian",
    "Command",
    "ControlRun",
    "Controller",
    "Observation",
    "PostureController",
    "simulate",
    "plan_walk",
    "WalkPlan",
    "Recording",
    "load_recording",
    "animation",
    "clearance",
    "contact",
    "dynamics",
    "engines",
    "exceptions",
    "experiments",
    "feasibility",
    "figures",
    "gait",
    "kinematics",
    "measures",
    "mjcf",
    "paper",
    "posture",
    "rising",
    "sliders",
    "stability",
    "stance",
    "steering",
    "studies",
    "study",
    "support_region",
    "swing",
    "symbolic",
    "terrain",
    "transforms",
    "urdf",
    "walker",
]
