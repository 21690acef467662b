"""Tables and figures from stored records; nothing here simulates. The only importers of matplotlib."""
