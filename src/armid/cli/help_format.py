"""Layout of the help of a command: arguments in the form of the command line, and switches without a type."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

from armid.cli.remedy_hints import CONTEXT


class Command(TyperCommand):
    """Command whose help shows arguments such as `STUDY | ROBOT RECORDING…`, and switches without a type."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        for param in self.params:
            _without_type(param)

    def invoke(self, ctx: Any) -> Any:
        """Run the command. Its context is stored while it runs, because remedies name options of the command."""
        token = CONTEXT.set(ctx)
        try:
            return super().invoke(ctx)
        finally:
            CONTEXT.reset(token)

    def get_help_option(self, ctx: Any) -> Any:
        """The option --help, shown as a switch without a type."""
        return _without_type(super().get_help_option(ctx))

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Options and arguments for the usage line of the command."""
        parts = [self.options_metavar or ""]
        parts += [_usage(param) for param in self.get_params(ctx) if param.param_type_name == "argument"]
        return [part for part in parts if part]


def _without_type(param: Any) -> Any:
    """Removes the type from the help of a switch, and returns the parameter."""
    if getattr(param, "is_flag", False):
        param.metavar = ""
    return param


def _usage(param: Any) -> str:
    """Text of an argument in the usage line: in brackets if it is optional, in parentheses if it has alternatives."""
    text = param.metavar or param.name.upper()
    if param.nargs == -1 and "…" not in text:
        text += "…"
    if text.startswith("["):
        return text
    if not param.required:
        return f"[{text}]"
    return f"({text})" if " | " in text else text
