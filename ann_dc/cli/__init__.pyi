from .commands.app import main as main
