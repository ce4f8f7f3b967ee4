from .cell import cell_listing as cell_listing
from .circuit import CircuitReport as CircuitReport
from .coordination import (
    coordination_table as coordination_table,
    iterations_dict as iterations_dict,
    iterations_table as iterations_table,
)
from .design import (
    candidate_table as candidate_table,
    design_dict as design_dict,
    diagnosis_dict as diagnosis_dict,
    write_design as write_design,
)
from .json_file import make_room as make_room, write_json as write_json
from .ladder import ladder_table as ladder_table, write_ladder as write_ladder
from .paper import paper_table as paper_table
from .plants import plant_page as plant_page, plant_table as plant_table
from .solution import report_table as report_table, write_solution as write_solution
from .study_page import write_study_page as write_study_page
from .tables import (
    measured as measured,
    named_rows as named_rows,
    printable as printable,
    span as span,
    table as table,
    unit_list as unit_list,
    verdict_text as verdict_text,
)
