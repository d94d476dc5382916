"""Commands: their help shows an option that takes no value without a type, and their faults are in our words."""

from __future__ import annotations

from typing import Any

from typer import BadParameter
from typer.core import TyperCommand, TyperGroup

from rig.errors import UsageError


class _Flags:
    """Removes the type `<bool>` behind flags in the help, which would invite a value: `--view true`."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, flags with an empty type."""
        found: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for one in found:
            if getattr(one, "is_flag", False):
                one.metavar = ""
        return found

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments. Raises typer.BadParameter, which states what was given and what is allowed."""
        self._refuse_twice(ctx, args)
        try:
            found: list[str] = super().parse_args(ctx, args)  # type: ignore[misc]
        except BadParameter as error:
            from pydantic import ValidationError  # only where something is wrong: start-up counts

            from rig.quantities import faults_of

            if isinstance(cause := error.__cause__, ValidationError):
                error.message = "; ".join(f"{fault} (given: {given})" for _, fault, given in faults_of(cause))
            raise
        return found

    def _refuse_twice(self, ctx: Any, args: list[str]) -> None:
        """Raise typer.BadParameter for an option with one value that is given twice: the first would be ignored."""
        if self.params and not ctx.resilient_parsing:  # type: ignore[attr-defined]
            order = self.make_parser(ctx).parse_args(args=[*args])[2]  # type: ignore[attr-defined]
            for one in order:
                single = one.param_type_name == "option" and not (one.multiple or one.is_flag or one.count)
                if single and order.count(one) > 1:
                    raise BadParameter("is given twice, and takes one value", ctx=ctx, param=one)


class Command(_Flags, TyperCommand):
    """A command."""


class Group(_Flags, TyperGroup):
    """A command with commands below it."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the first argument names. Raises UsageError, which names those that are like it."""
        if args and self.get_command(ctx, args[0]) is None and not ctx.resilient_parsing:
            from rig.scenes.faults import near

            known = self.list_commands(ctx)
            longer = [name for name in known if name.startswith(args[0])]
            hint = f"did you mean {' or '.join(longer)}?" if longer else near(args[0], known, f"{ctx.command_path} -h")
            raise UsageError(f"{ctx.command_path} has no command {args[0]!r:.60}: {hint}")
        return super().resolve_command(ctx, args)
