"""The modules of the workflows; each is imported when it is first used."""

from . import compare as compare
from . import demo as demo
from . import doctor as doctor
from . import export as export
from . import files as files
from . import gap as gap
from . import identify as identify
from . import model as model
from . import parameters as parameters
from . import record as record
from . import report as report
from . import simulate as simulate
from . import trajectory as trajectory
from . import validate as validate
