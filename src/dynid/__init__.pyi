"""What ``dynid`` exports and where each name lives; it is imported when it is first used."""

from . import errors as errors
from . import loading as loading
from .estimation.result import Identification as Identification
from .loading import (
    load_log as load_log,
)
from .loading import (
    load_robot as load_robot,
)
from .log import Log as Log
from .model.base_model import BaseModel as BaseModel
from .motion import Motion as Motion
from .options import LogOptions as LogOptions
from .robot import Robot as Robot
from .trajectory.options import PlanOptions as PlanOptions
from .version import __version__ as __version__
from .workflows.compare import compare as compare
from .workflows.export import (
    ExportedModel as ExportedModel,
)
from .workflows.export import (
    export as export,
)
from .workflows.gap import (
    Gap as Gap,
)
from .workflows.gap import (
    find_gap as find_gap,
)
from .workflows.gap import (
    load as load,
)
from .workflows.identify import (
    find_payload as find_payload,
)
from .workflows.identify import (
    identify as identify,
)
from .workflows.model import base_model as base_model
from .workflows.options import (
    ExportOptions as ExportOptions,
)
from .workflows.options import (
    GapOptions as GapOptions,
)
from .workflows.options import (
    IdentifyOptions as IdentifyOptions,
)
from .workflows.options import (
    ModelOptions as ModelOptions,
)
from .workflows.options import (
    SimulateOptions as SimulateOptions,
)
from .workflows.options import (
    ValidateOptions as ValidateOptions,
)
from .workflows.parameters import (
    Observations as Observations,
)
from .workflows.parameters import (
    observe as observe,
)
from .workflows.report import (
    Report as Report,
)
from .workflows.report import (
    report as report,
)
from .workflows.simulate import (
    Simulation as Simulation,
)
from .workflows.simulate import (
    compare_in_simulator as compare_in_simulator,
)
from .workflows.simulate import (
    simulate as simulate,
)
from .workflows.trajectory import (
    Plan as Plan,
)
from .workflows.trajectory import (
    plan_trajectory as plan_trajectory,
)
from .workflows.validate import (
    Validation as Validation,
)
from .workflows.validate import (
    validate as validate,
)
