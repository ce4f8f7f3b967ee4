from .picture import cell_page as cell_page
