"""Laws of no name: learned as tables over one state or over two, and said as formulas."""
