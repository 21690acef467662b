"""Training of the learned strategies; nothing imports it but its own command."""
