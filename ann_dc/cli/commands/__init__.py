"""The commands, a module each: words become objects, the library is called, a report is printed."""
