from .loop_gains import LoopGain as LoopGain, loop_gains as loop_gains
