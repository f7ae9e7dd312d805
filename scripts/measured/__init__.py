"""Parts of the pages that are measured, a module for each page or study."""
