from .study_page import write_study_page as write_study_page
