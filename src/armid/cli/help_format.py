"""Usage and options of a command as it shows them: arguments as they are written, switches without a type."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

from armid.cli.hints import CONTEXT

__all__ = ["Command"]


class Command(TyperCommand):
    """A command whose help has `STUDY | ROBOT RECORDING…` for an argument and nothing behind a switch."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        for param in self.params:
            _bare(param)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; hints know its options."""
        CONTEXT.set(ctx)
        return super().invoke(ctx)

    def get_help_option(self, ctx: Any) -> Any:
        """The option for help, a switch as others are."""
        return _bare(super().get_help_option(ctx))

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Options and arguments of the line that says how the command is used."""
        pieces = [self.options_metavar or ""]
        pieces += [_usage(param) for param in self.get_params(ctx) if param.param_type_name == "argument"]
        return [piece for piece in pieces if piece]


def _bare(param: Any) -> Any:
    """A switch without a type to give."""
    if getattr(param, "is_flag", False):
        param.metavar = ""
    return param


def _usage(param: Any) -> str:
    """An argument: in brackets where it may be left out, in parentheses where it is one of several."""
    text = param.metavar or param.name.upper()
    if param.nargs == -1 and "…" not in text:
        text += "…"
    if text.startswith("["):
        return text
    if not param.required:
        return f"[{text}]"
    return f"({text})" if " | " in text else text
