from .film import film as film
from .journey import journey as journey, plane as plane
