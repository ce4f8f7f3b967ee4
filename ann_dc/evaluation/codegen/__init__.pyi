from .evaluator import GeneratedEvaluator as GeneratedEvaluator, fast_evaluator as fast_evaluator
