"""The immutable robot value, a file a part: a description's values, checked, and nothing that is derived from them."""

from ..elements.spring import Spring as Spring
from ..geometry import ANGULAR as ANGULAR
from ..geometry import COORDINATES as COORDINATES
from ..geometry import LINEAR as LINEAR
from ..geometry import Placement as Placement
from ..laws import Curve as Curve
from .coordinate import ACROSS as ACROSS
from .coordinate import COORDINATE_NUMBERS as COORDINATE_NUMBERS
from .coordinate import Coordinate as Coordinate
from .coordinate import Friction as Friction
from .coordinate import carriers as carriers
from .coordinate import load_dependent as load_dependent
from .coupling import Coupling as Coupling
from .coupling import first_contradiction as first_contradiction
from .joint import CUT_NUMBERS as CUT_NUMBERS
from .joint import JOINT_TYPES as JOINT_TYPES
from .joint import MOTOR as MOTOR
from .joint import PRINCIPAL as PRINCIPAL
from .joint import Joint as Joint
from .joint import Loop as Loop
from .joint import Motor as Motor
from .link import BASE as BASE
from .link import INERTIA_KEYS as INERTIA_KEYS
from .link import Frame as Frame
from .link import Link as Link
from .robot import Robot as Robot
