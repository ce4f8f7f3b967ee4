"""What is said of a result, on the screen and in files: tables, JSON.

The command line prints what these modules return; they know nothing of it.
"""
