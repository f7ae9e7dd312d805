"""Write docs/columns.md from the table of columns."""

from pathlib import Path

from agrobot_mj.simulation.reference import reference

PAGE = Path(__file__).parent.parent / "docs" / "columns.md"

if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
    print(PAGE)
