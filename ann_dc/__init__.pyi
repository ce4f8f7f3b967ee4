# The public names, by verb; every room hands on more.
from . import errors as errors, plotting as plotting, two_level as two_level

# analyse
from .analysis import equilibrium as equilibrium, spectrum as spectrum

# run
from .backends import OdeBackend as OdeBackend, Settling as Settling, ode as ode
from .backends.recurrent import (
    SIMULTANEOUS as SIMULTANEOUS,
    STAGE_BY_STAGE as STAGE_BY_STAGE,
    TWO_PHASE as TWO_PHASE,
    AdaptiveStep as AdaptiveStep,
    Anderson as Anderson,
    FixedStep as FixedStep,
    RecurrentBackend as RecurrentBackend,
    RecurrentLayer as RecurrentLayer,
)
from .backends.recurrent.cell import CellLayer as CellLayer
from .backends.spice import SpiceBackend as SpiceBackend

# decompose
from .decomposition import (
    CORRECTED as CORRECTED,
    PRINTED as PRINTED,
    SWITCHES as SWITCHES,
    Form as Form,
    StageEquations as StageEquations,
    decompose as decompose,
    switch as switch,
)
from .evaluation import evaluator as evaluator
from .export.weights import load as load, save as save
from .gain_design import (
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Gains as Gains,
    Recipe as Recipe,
    apply_gains as apply_gains,
    hand_gains as hand_gains,
)

# build
from .hardware.emulation import defects as defects, emulate as emulate
from .hardware.parts import levels as levels, presets as presets
from .network import Network as Network

# certify, keep
from .optimality import certify as certify

# declare
from .problem import (
    OptimalControlProblem as OptimalControlProblem,
    Start as Start,
    line_start as line_start,
    load_problem as load_problem,
    plants as plants,
    random_start as random_start,
    zero_start as zero_start,
)
from .resources import circuits_path as circuits_path
from .solution import Solution as Solution

# synthesize, design, solve
from .solver import design as design, solve as solve, synthesize as synthesize
from .two_level import (
    TwoLevelLayer as TwoLevelLayer,
    UpperMap as UpperMap,
    theorem_IV_2 as theorem_IV_2,
)

__version__: str
