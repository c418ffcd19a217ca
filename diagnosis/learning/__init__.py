"""Laws of no name, learned where no name explains a recording, and what formulas they look like."""
