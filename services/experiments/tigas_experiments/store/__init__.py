"""The experiments' store over HTTP: takes runs that a page made, and gives lists, reports and archives of all."""
