"""Packages of the distribution: its wheel has the controllers as rj_agents, which in the repository are agents.

Other distributions, and folders of users, are called agents; there is no other rj_agents. The wheel holds the files of
agents with this name in their imports, commands and messages. An editable install knows the same files by both names.
The page of an index is README.md with links that lead somewhere. pyproject.toml has all else.

Where .ci/platform_wheel.py has put compiled kernels beside the sources, the wheel is one of this Python and platform.
"""

import re
import shutil
import tomllib
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel

HERE, INSTALLED = "agents", "rj_agents"
NAME = re.compile(rf"\b{HERE}(?=\.[a-z_])|(?<=from ){HERE}(?= import )")
LINK = re.compile(r"(?P<image>!?)\[(?P<words>[^\]]*)\]\((?P<path>(?!\w+:|#)[^)\s]+)\)")
CONTROLLERS = find_packages(include=[HERE, f"{HERE}.*"])


class BuildRenamed(build_py):
    """Copies modules, those of the controllers with their installed name, and configurations."""

    def build_module(self, module: str, module_file: str, package: str) -> tuple[str, bool]:
        """Copy one module; where it went, and whether it was copied."""
        copied, is_new = super().build_module(module, module_file, package)
        if package.partition(".")[0] == INSTALLED:
            text = Path(module_file).read_text("utf-8")
            Path(copied).write_text(NAME.sub(INSTALLED, text), "utf-8", newline="\n")
        return copied, is_new

    def run(self) -> None:
        """Copy the packages, and the ready-made configurations into the one of the controllers."""
        super().run()
        if not self.editable_mode:
            for file in Path("configs").glob("*/*.yaml"):
                target = Path(self.build_lib) / INSTALLED / file
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target)


class PlatformWheel(bdist_wheel):
    """A wheel with machine code in it."""

    def finalize_options(self) -> None:
        """Name the interpreter and the platform."""
        super().finalize_options()
        self.root_is_pure = False


class InstallBothNames(editable_wheel):
    """An editable install: the files in the repository, which import each other as agents."""

    def run(self) -> None:
        """Make the wheel that points to the repository."""
        self.distribution.packages = [*self.distribution.packages, *CONTROLLERS]
        super().run()


def page_of_index(text: str, address: str | None) -> str:
    """README.md where no file is beside it: links to files of the repository at this address, or their words alone."""

    def elsewhere(found: re.Match[str]) -> str:
        image, words, path = found["image"], found["words"], found["path"]
        if address is None:
            return "" if image else words
        return f"{image}[{words}]({address}/{'raw' if image else 'blob'}/main/{path})"

    return LINK.sub(elsewhere, text)


def long_description() -> str:
    """README.md with links to the repository that pyproject.toml names."""
    project = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["project"]
    return page_of_index(Path("README.md").read_text("utf-8"), project.get("urls", {}).get("Repository"))


def main() -> None:
    """Build as the command line says."""
    setup(
        long_description=long_description(),
        long_description_content_type="text/markdown",
        packages=[
            *find_packages(include=["rollingjoint", "rollingjoint.*", "rj_gym", "rj_gym.*"]),
            *(f"{INSTALLED}{package.removeprefix(HERE)}" for package in CONTROLLERS),
        ],
        package_dir={INSTALLED: HERE},
        cmdclass={"build_py": BuildRenamed, "editable_wheel": InstallBothNames}
        | ({"bdist_wheel": PlatformWheel} if Path("rollingjoint/machine_code").is_dir() else {}),
    )


if __name__ == "__main__":
    main()
