"""Parts of the report that have a page or a file of their own."""
