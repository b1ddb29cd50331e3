"""The folder of a study: its paths, and its journal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import optuna
from optuna.study import Study

from agents.runs.files import RunFolderError, write_text
from agents.tuning.journal import journal_storage, opened
from agents.tuning.study import StudyConfig, load_study
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class StudyFolder:
    """Paths of a study, and its journal.

    Args:
        storage: URL of a storage of Optuna that holds the trials; none: the file journal.log in the folder.
    """

    path: Path
    storage: str = ""

    def config(self, file: Path | None) -> StudyConfig:
        """The configuration of the study; raises ConfigError where `file` differs from the study in the folder."""
        study = self.path / "study.yaml"
        if file is None and not study.is_file():
            raise ConfigError("--config", None, f"a YAML file, since no study is in {self.path}")
        config = load_study(study if file is None else file)
        if study.is_file() and replace(load_study(study), trials=config.trials) != config:
            hint = "Leave --config out to go on with the study, or give another --study."
            raise ConfigError("--config", str(file), f"what the study in {self.path} began with", hint)
        return config

    def begin(self, config: StudyConfig) -> None:
        """Make the folder, unless the study is there; raises RunFolderError for a folder that holds something else."""
        if not (self.path / "study.yaml").is_file():
            names = (".study.yaml", "lock")  # another process may just begin it
            if self.path.exists() and not all(path.name.startswith(names) for path in self.path.iterdir()):
                raise RunFolderError("study", str(self.path), "a new folder, or one with a study", "It stays as it is.")
            write_text(self.path / "study.yaml", dump_yaml(config.to_dict()))

    def journal(self, config: StudyConfig) -> Study:
        """The study as Optuna knows it, in a file that several processes may write, or in the storage.

        Raises ConfigError for a storage that cannot be opened.
        """
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        pruners = {
            "median": optuna.pruners.MedianPruner(n_startup_trials=config.startup),
            "halving": optuna.pruners.SuccessiveHalvingPruner(),
            "none": optuna.pruners.NopPruner(),
        }
        name = self.path.resolve().name if self.storage else "study"  # a storage may hold several
        storage = opened(self.storage) if self.storage else journal_storage(self._file)
        return optuna.create_study(storage=storage, study_name=name, load_if_exists=True, pruner=pruners[config.pruner])

    def reached(self, config: StudyConfig) -> Study:
        """The same from a worker; raises ConfigError where it does not see the file."""
        if not self.storage and not self._file.is_file():
            hint = "Trials end early by the scores of others: every machine needs the storage; or set pruner: none."
            raise ConfigError("--storage", self.storage, f"a URL, since {self._file} is not on this machine", hint)
        return self.journal(config)

    @property
    def _file(self) -> Path:
        return self.path / "journal.log"

    def trial(self, number: int) -> Path:
        """Folder of a trial."""
        return self.path / "trials" / f"{number:04d}"
