"""What stored records say: metrics, statistics, tables, claims, the gate."""
