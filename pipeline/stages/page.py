"""Stage page of a study: write its index.html, figures and tables into the study's own folder."""

import argparse
import importlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from pipeline.launch import load
from pipeline.report.page import Site, environment, provenance, render_page, write_files, write_provenance
from pipeline.report.study import Study, of_parameters
from pipeline.runtime.errors import InputError, reported
from pipeline.runtime.places import PARAMS

HOME = "../../reports/"  # the paper's pages, seen from a study's folder


def main(argv: list[str]) -> None:
    """Read the study's results and parameters, and write its page with provenance.json."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.stages.page", description=__doc__)
    parser.add_argument("study", help="name of a folder in studies/")
    parser.add_argument("--params", type=Path, default=PARAMS, metavar="FILE")
    given = parser.parse_args(argv)
    folder = Path("studies") / given.study
    if not (folder / "page.html.j2").is_file():
        raise InputError(f"{folder} has no page.html.j2: expected the name of a study with a page")
    cfg = load(given.params)
    site = render(read_study(cfg, given.study), folder)
    write_files(site, folder)
    write_provenance(site, folder, provenance(cfg))


def read_study(cfg: DictConfig, name: str) -> Study:
    """Return the study's results and parameters. Raise InputError if params.yaml has none."""
    if name not in cfg.studies:
        raise InputError(f"{PARAMS} has no studies.{name}: run `python -m pipeline.params`")
    settings: Any = OmegaConf.to_container(cfg.studies[name], resolve=True)
    facts = provenance(cfg) | {"settings": OmegaConf.to_yaml(cfg.studies[name]), "studies": [name]}
    folder = Path(cfg.paths.studies) / name
    return Study(name=name, folder=folder, settings=settings, facts=facts, **of_parameters(cfg))


def render(study: Study, folder: Path) -> Site:
    """Return the page of a study by the template in `folder`.

    Raise InputError or ValueError if it uses a number that is missing or not finite.
    """
    names = {name: getattr(study, name) for name in ("facts", "settings", "value", "values", "variants")}
    names |= {"home": HOME, "r": study, "question": study.settings["question"], "n": study.main_n_demos}
    made, site = environment([folder], pages={"index": "Overview"}, **names), Site()
    drawn = (folder / "figures.py").is_file()
    figures = importlib.import_module(f"studies.{study.name}.figures") if drawn else None
    render_page("study", "page.html.j2", figures, study, made, site)
    return replace(site, pages={"index": site.pages["study"]}, read={"index": site.read.get("study", {})})


if __name__ == "__main__":
    with reported():
        main(sys.argv[1:])
