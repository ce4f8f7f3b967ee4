from .vector import ReferenceVector as ReferenceVector, reference_vector as reference_vector
