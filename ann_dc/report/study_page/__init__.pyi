from .page import write_residuals as write_residuals, write_study_page as write_study_page
