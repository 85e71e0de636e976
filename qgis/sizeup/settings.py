"""The plugin's settings, in the options of Processing."""

from processing.core.ProcessingConfig import ProcessingConfig, Setting

from . import program
from .words import Speaks

PROGRAM = "SIZEUP_PROGRAM"


def register(group: str, icon) -> None:
    """Adds the settings to Settings > Options > Processing > Providers."""
    ProcessingConfig.settingIcons[group] = icon
    ProcessingConfig.addSetting(
        Setting(
            group,
            PROGRAM,
            Speaks.tr("sizeup program (empty: the one on the path)"),
            "",
            valuetype=Setting.FILE,
        )
    )
    ProcessingConfig.readSettings()


def unregister() -> None:
    """Takes them away."""
    ProcessingConfig.removeSetting(PROGRAM)


def sizeup() -> str:
    """The program's file, looked at: it is there and new enough. Raises program.ProgramError."""
    found = program.find(ProcessingConfig.getSetting(PROGRAM) or "")
    program.check(found)
    return found
