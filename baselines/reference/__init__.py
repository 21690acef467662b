"""References: what is possible in a world that is known. They are told the truth and compared with nobody."""
