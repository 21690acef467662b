"""What a trial takes place in: scenarios and their files, maps of others, and what is true of each kind of world."""
