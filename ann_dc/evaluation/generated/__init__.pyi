from .choice import FastEvaluator as FastEvaluator, fast_evaluator as fast_evaluator
from .generated import GeneratedEvaluator as GeneratedEvaluator
from .lanes import Entry as Entry, Lanes as Lanes
from .plan import WRITTEN_OUT as WRITTEN_OUT, Axis as Axis, refusal as refusal
