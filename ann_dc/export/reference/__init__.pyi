from .vector import EulerWalk as EulerWalk, reference_vector as reference_vector
