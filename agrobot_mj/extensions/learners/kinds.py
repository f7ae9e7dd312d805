"""Guidance laws and steering loops registered by this extension."""

from agrobot_mj.extensions.learners.adaptive_loop import AdaptiveLoop
from agrobot_mj.extensions.learners.eso import Eso
from agrobot_mj.extensions.learners.ilc import Ilc
from agrobot_mj.extensions.learners.implement_ilc import ImplementIlc
from agrobot_mj.extensions.learners.learned_feedforward import LearnedFeedforward

KINDS = (Eso, LearnedFeedforward, Ilc, ImplementIlc, AdaptiveLoop)
