from .config import TriangulationConfig as TriangulationConfig
from .keypoints import Keypoints as Keypoints
from .landmarks import BodyPoints as BodyPoints
from .landmarks import Landmark as Landmark
from .landmarks import load_landmarks as load_landmarks
from .landmarks import locate_points as locate_points
from .triangulation import Triangulation as Triangulation
from .triangulation import triangulate as triangulate
