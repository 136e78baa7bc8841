from .keypoints import Keypoints as Keypoints
from .keypoints import Triangulation as Triangulation
from .keypoints import TriangulationConfig as TriangulationConfig
from .keypoints import triangulate as triangulate
from .landmarks import BodyPoints as BodyPoints
from .landmarks import Landmark as Landmark
from .landmarks import load_landmarks as load_landmarks
from .landmarks import locate_points as locate_points
