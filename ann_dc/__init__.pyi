# The public names, by verb; every room hands on more.
# ruff: noqa: I001

__version__: str

from . import errors as errors
from . import plotting as plotting
from . import report as report
from . import two_level as two_level

# declare
from .problem import OptimalControlProblem as OptimalControlProblem
from .problem import Soft as Soft
from .problem import InitialGuess as InitialGuess
from .problem import StepLength as StepLength
from .problem import interpolated_guess as interpolated_guess
from .problem import load_problem as load_problem
from .problem import plants as plants
from .problem import random_guess as random_guess
from .problem import zero_guess as zero_guess

# decompose
from .decomposition import CORRECTED as CORRECTED
from .decomposition import PRINTED as PRINTED
from .decomposition import SWITCHES as SWITCHES
from .decomposition import Form as Form
from .decomposition import StageEquations as StageEquations
from .decomposition import decompose as decompose
from .decomposition import switch as switch

# synthesize, design, solve
from .analysis import SETTLING_TIME as SETTLING_TIME
from .analysis import STEPS as STEPS
from .analysis import TWO_PHASE_STEPS as TWO_PHASE_STEPS
from .solver import design as design
from .solver import solve as solve
from .solver import synthesize as synthesize
from .families import FamilyDesign as FamilyDesign
from .families import Multistart as Multistart
from .families import multistart as multistart
from .families import pareto as pareto
from .gain_design import DIAGONAL_RULE as DIAGONAL_RULE
from .gain_design import Gains as Gains
from .gain_design import GainRule as GainRule
from .gain_design import apply_gains as apply_gains
from .gain_design import manual_gains as manual_gains
from .network import Network as Network, Waveform as Waveform
from .scale import Scale as Scale
from .network.preconditioners import PreconditionerKind as PreconditionerKind
from .solution import Solution as Solution

# analyse
from .analysis import equilibrium as equilibrium
from .analysis import spectrum as spectrum
from .diagnosis import diagnose as diagnose
from .evaluation import evaluator as evaluator
from .two_level import UpperMap as UpperMap
from .two_level import theorem_IV_2 as theorem_IV_2

# run
from .backends import OdeBackend as OdeBackend
from .backends import Settling as Settling
from .backends import ode as ode
from .backends.step_rules import SIMULTANEOUS as SIMULTANEOUS
from .backends.step_rules import STAGE_BY_STAGE as STAGE_BY_STAGE
from .backends.step_rules import TWO_PHASE as TWO_PHASE
from .backends.step_rules import AdaptiveStep as AdaptiveStep
from .backends.step_rules import Anderson as Anderson
from .backends.step_rules import FixedStep as FixedStep
from .backends.recurrent import RecurrentBackend as RecurrentBackend
from .backends.layers import RecurrentLayer as RecurrentLayer
from .backends.layers import CellLayer as CellLayer
from .backends.spice import SpiceBackend as SpiceBackend
from .two_level import TwoLevels as TwoLevels

# build
from .hardware import nonidealities as nonidealities
from .hardware.emulation import emulate as emulate
from .hardware.parts import levels as levels
from .hardware.parts import presets as presets
from .resources import circuits_path as circuits_path

# study
from .study import Study as Study
from .study import load_study as load_study
from .study import load_table as load_table

# certify, keep
from .optimality import certify as certify
from .export import export_network as export_network
from .export import inspect_export as inspect_export
from .weights import load as load
from .weights import save as save
from .solution import load_solution as load_solution

# measure
from .timing import Stopwatch as Stopwatch
