from .app import main as main
from .building import network_to_build as network_to_build
