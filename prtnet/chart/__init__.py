"""From score rows to what people look at: tables, charts, contact sheets, pages."""
