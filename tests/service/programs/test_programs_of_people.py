"""Programs in the forms of people: how many moves to numbers are known as sent, and after one question.

The shares are printed by

    python -m benchmarks shares
"""

import numpy as np
import pytest
from support.program_forms import LANGUAGES, read_forms
