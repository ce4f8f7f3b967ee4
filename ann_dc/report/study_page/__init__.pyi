from .choice import chosen as chosen
from .figure import Figure as Figure
from .packed import pack as pack
from .page import page_of as page_of, write_study_page as write_study_page
