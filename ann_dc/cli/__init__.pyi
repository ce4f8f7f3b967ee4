from .commands.app import app as app, main as main
from .terminal import notes as notes, progress_line as progress_line
