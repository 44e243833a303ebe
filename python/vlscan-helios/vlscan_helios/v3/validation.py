"""Types of values: quantities with units, files, arrays, and the base of all settings."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NoReturn, TypeAlias

import numpy as np
import pint
from pydantic import BeforeValidator, ConfigDict, PlainSerializer, ValidationError
from pydantic import PositiveInt as PositiveInt
from pydantic_core import InitErrorDetails, PydanticCustomError

from vlscan.errors import warn

from .errors import WrongTypeError
from .utils import find_files, is_real_iterable, named_file

if TYPE_CHECKING:
    # The base of pint.Quantity, which has no declared type.
    from pint.facets.plain import PlainQuantity
    from pydantic.fields import FieldInfo
    from typing_extensions import Self

    class BaseModel:
        """Base of models for type checkers: their values may be texts and quantities, by keyword or in the order of fields."""

        model_config: ClassVar[ConfigDict]
        model_fields: ClassVar[dict[str, FieldInfo]]
        model_fields_set: set[str]
        __signature__: ClassVar[inspect.Signature]
        __pydantic_fields_set__: set[str]

        def __init__(self, *args: Any, **values: Any) -> None: ...
        def __iter__(self) -> Iterator[tuple[str, Any]]: ...
        def __copy__(self) -> Self: ...
        def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self: ...
        def model_dump(self, **options: Any) -> dict[str, Any]:
            """Return the values."""

        @classmethod
        def model_validate(cls, obj: Any) -> Self:
            """Return a model of values."""
else:
    from pydantic import BaseModel

#: The units of all quantities.
units: pint.UnitRegistry[float] = pint.get_application_registry()  # type: ignore[no-untyped-call]


def number(value: object, unit: str) -> float:
    """Return a quantity as a number in ``unit``; plain numbers are in ``unit`` already.

    Parameters
    ----------
    value : object
        A number, a quantity of pint, or a text such as ``10 deg/s``.
    unit : str
        The unit.

    Returns
    -------
    float
        The number.

    Raises
    ------
    ValueError
        No quantity, or one of another dimension.
    """
    if isinstance(value, bool):
        raise ValueError(f"expected a number, a quantity or a text with a unit, found {value}")
    try:
        if isinstance(value, str):
            value = units.parse_expression(value)
        if isinstance(value, pint.Quantity):
            return float(value.to(unit).magnitude)
        return float(value)  # type: ignore[arg-type]
    except Exception as problem:
        # Parsing of texts raises errors of many kinds.
        reason = str(problem) or f"{value!r} is no quantity"
        raise ValueError(f"expected a number or a quantity in {unit}: {reason}") from None


def _quantity(unit: str, lowest: float | None = None, *, is_above: bool = False) -> BeforeValidator:
    def validate(value: object) -> float:
        found = number(value, unit)
        if lowest is not None and (not lowest <= found < math.inf or is_above and found == lowest):
            raise ValueError(f"expected {'more than' if is_above else 'at least'} {lowest:g} {unit}, found {found:g}")
        return found

    return BeforeValidator(validate)


def _magnitudes(value: PlainQuantity[Any], unit: str) -> Any:
    """Return the numbers of a quantity of several in a unit."""
    try:
        return value.to(unit).magnitude
    except pint.errors.PintError as problem:
        raise ValueError(f"expected numbers or a quantity in {unit}: {problem}") from None


def _numbers(count: int) -> BeforeValidator:
    def validate(value: Any) -> Any:
        if isinstance(value, pint.Quantity):
            value = _magnitudes(value, "m")
        if isinstance(value, (list, tuple)):
            found = np.array([number(part, "m") for part in value])
        elif isinstance(value, (set, dict)):
            raise ValueError(f"expected {count} numbers in order, found {value!r}")
        else:
            found = np.asarray(value, dtype=float)
        if found.shape != (count,) or not np.isfinite(found).all():
            raise ValueError(f"expected {count} finite numbers, found {value!r}")
        return found

    return BeforeValidator(validate)


def _directory(value: Any) -> Path:
    if not isinstance(value, (str, os.PathLike)):
        raise ValueError(f"expected a folder, found {type(value).__name__}")
    path = Path(value)
    path.mkdir(parents=True, exist_ok=True)
    return path


def existing_files(value: Any) -> list[Path]:
    """Return the files of a pattern, or of several names and patterns; a missing one is a ``FileNotFoundError``."""
    if isinstance(value, (str, os.PathLike)):
        return find_files(value)
    if not is_real_iterable(value):
        raise WrongTypeError(f"expected a file, a pattern or several of them, found {type(value).__name__}")
    return [path for each in value for path in find_files(each)]


# Names of levels of compression.
_LEVELS = {"none": 0, "fast": 1, "default": 6, "best": 9}


def _compression(value: Any) -> int:
    level = _LEVELS.get(value, value) if isinstance(value, str) else value
    if isinstance(level, bool) or not isinstance(level, int) or not 0 <= level <= 9:
        raise ValueError(f"compression level is {value!r}, expected 0 to 9, {', '.join(_LEVELS)}")
    return level


def _several(value: Any) -> Any:
    if isinstance(value, Model):
        kind = type(value).__name__
        raise ValueError(f"expected a list or a tuple, found one {kind}: [{kind}(...)]")
    return value


def _components(value: Any) -> Any:
    # A copy: an array of the program may change, and may be that of several materials.
    found = np.array(value, dtype=np.float64)
    if found.shape == (3,):
        found = np.append(found, 0.0)
    if found.shape != (4,):
        raise ValueError(f"expected 4 numbers, found {value!r}")
    return found


# Numbers in SI units, of a number, a quantity or a text with a unit.
Angle = Annotated[float, _quantity("rad")]
AngleVelocity = Annotated[float, _quantity("rad/s")]
Frequency = Annotated[float, _quantity("Hz", 0)]
ScanFrequency = Annotated[float, _quantity("Hz", 0)]
TimeInterval = Annotated[float, _quantity("s", 0)]
PositiveTimeInterval = Annotated[float, _quantity("s", 0, is_above=True)]
#: A time on the clock of a trajectory.
TimePoint = Annotated[float, _quantity("s")]
Length = Annotated[float, _quantity("m", 0)]
PositiveLength = Annotated[float, _quantity("m", 0, is_above=True)]
Coordinate = Annotated[float, _quantity("m")]
Speed = Annotated[float, _quantity("m/s", 0)]
#: Number of threads; ``None`` is all.
ThreadCount: TypeAlias = PositiveInt | None
#: A number from 0 to 9, or a name.
CompressionLevel = Annotated[int, BeforeValidator(_compression)]
if TYPE_CHECKING:
    AssetPath: TypeAlias = str | os.PathLike[str]
    MultiAssetPath: TypeAlias = Any
    AnyAngle: TypeAlias = float | str | PlainQuantity[Any]
else:
    #: An existing file, as named or in an asset directory.
    AssetPath = Annotated[Path, BeforeValidator(named_file)]
    #: Existing files: a pattern, or several of them.
    MultiAssetPath = Annotated[list[Path], BeforeValidator(existing_files)]
    #: An angle as an argument.
    AnyAngle = Angle
#: A folder that is created if it does not exist.
CreatedDirectory = Annotated[Path, BeforeValidator(_directory)]
#: Check of a tuple of models, which one of them is not.
SEVERAL = BeforeValidator(_several)
#: Three numbers.
R3Vector = Annotated[Any, _numbers(3)]
#: w, x, y, z.
Quaternion = Annotated[Any, _numbers(4)]
#: Four components of a colour.
Components = Annotated[Any, BeforeValidator(_components), PlainSerializer(np.ndarray.tolist, when_used="json")]


def same(a: object, b: object) -> bool:
    """Return whether two values are equal; NaN equals NaN.

    Parameters
    ----------
    a, b : object
        The values.

    Returns
    -------
    bool
        True if they are.
    """
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b):
        return True
    return bool(a == b)


class Model(BaseModel):
    """Values in the order of their fields or by keyword, which are checked when they are given and when they are changed.

    Unknown keywords are ``ValueError``. Other attributes can be set, and are not part of copies.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", validate_assignment=True, validate_default=True, arbitrary_types_allowed=True
    )
    if TYPE_CHECKING:
        __signature__: ClassVar[inspect.Signature]

    def __init__(self, *args: Any, **values: Any) -> None:
        names = list(type(self).model_fields)
        if len(args) > len(names):
            raise TypeError(f"{type(self).__name__}() takes {len(names)} values, found {len(args)}: {', '.join(names) or 'none'}")
        for name, value in zip(names, args, strict=False):
            if name in values:
                raise TypeError(f"{type(self).__name__}() got two values of {name}")
            values[name] = value
        for name in values.keys() - set(names):
            close = get_close_matches(name, names, 1)
            if close:
                # Other unknown keywords are refused by pydantic.
                fault = PydanticCustomError("extra_forbidden", f"there is no such field; did you mean {close[0]!r}?")
                details = InitErrorDetails(type=fault, loc=(name,), input=values[name])
                raise ValidationError.from_exception_data(type(self).__name__, [details])
        super().__init__(**values)

    def __setattr__(self, name: str, value: Any) -> None:
        kind = type(self)
        if name in kind.model_fields or name.startswith("_") or hasattr(kind, name):
            super().__setattr__(name, value)
            return
        close = get_close_matches(name, kind.model_fields, 1, 0.7)
        if close:
            warn(f"{kind.__name__} has no field {name!r}, which becomes an attribute of your own; did you mean {close[0]!r}?")
        object.__setattr__(self, name, value)

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        twin = super().__deepcopy__(memo)
        for name in twin.__dict__.keys() - type(self).model_fields.keys():
            del twin.__dict__[name]
        return twin

    def twin(self) -> Self:
        """Return a copy that shares its values, without attributes of the user.

        Returns
        -------
        Model
            The copy.
        """
        twin = BaseModel.__copy__(self)
        for name in twin.__dict__.keys() - type(self).model_fields.keys():
            del twin.__dict__[name]
        return twin

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """Return the values as a dictionary, those of settings by their own type.

        Parameters
        ----------
        **options : Any
            Options of ``pydantic.BaseModel.model_dump``.

        Returns
        -------
        dict
            The values.
        """
        found: dict[str, Any] = super().model_dump(**{"serialize_as_any": True, **options})
        return found

    def to_yaml(self, *args: Any, **values: Any) -> NoReturn:
        """Not offered: see the message.

        Parameters
        ----------
        *args, **values : Any
            Without effect.

        Raises
        ------
        NotImplementedError
            Always.
        """
        raise NotImplementedError(NO_YAML)

    def to_bundle(self, *args: Any, **values: Any) -> NoReturn:
        """Not offered: see the message.

        Parameters
        ----------
        *args, **values : Any
            Without effect.

        Raises
        ------
        NotImplementedError
            Always.
        """
        raise NotImplementedError(NO_YAML)

    @classmethod
    def from_yaml(cls, *args: Any, **values: Any) -> NoReturn:
        """Not offered: see the message.

        Parameters
        ----------
        *args, **values : Any
            Without effect.

        Raises
        ------
        NotImplementedError
            Always.
        """
        raise NotImplementedError(NO_YAML)

    @classmethod
    def from_bundle(cls, *args: Any, **values: Any) -> NoReturn:
        """Not offered: see the message.

        Parameters
        ----------
        *args, **values : Any
            Without effect.

        Raises
        ------
        NotImplementedError
            Always.
        """
        raise NotImplementedError(NO_YAML)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Document the fields, and their order."""
        cls.__signature__ = _signature(cls)
        if "Parameters\n" in (cls.__doc__ or "") or not cls.model_fields:
            return
        rows = []
        for name, field in cls.model_fields.items():
            kind = getattr(field.annotation, "__name__", str(field.annotation))
            default = "Required." if field.is_required() else f"Default: {field.get_default(call_default_factory=True)!s}."
            rows.append(f"{name} : {kind}\n    {default}")
        cls.__doc__ = "\n".join([f"{cls.__doc__}\n\nParameters\n----------", *rows])

    def clone(self) -> Self:
        """Return a copy that shares no values.

        Returns
        -------
        Model
            The copy.
        """
        return deepcopy(self)

    def _identity(self) -> object:
        """Return what distinguishes it beside its fields."""
        return None

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other) or not isinstance(other, Model):
            return False
        names = type(self).model_fields
        return self._identity() == other._identity() and all(same(getattr(self, name), getattr(other, name)) for name in names)

    __hash__: ClassVar[None] = None  # type: ignore[assignment]


#: Advice for files that are not offered.
NO_YAML = (
    "vlscan has no YAML and no bundles; Survey.to_xml() returns a survey as XML, StaticScene.to_binary() writes a scene, "
    "and all models pickle"
)


def _signature(kind: type[BaseModel]) -> inspect.Signature:
    """Return the signature of a model: its fields in order."""
    parameters, is_optional = [], False
    for name, field in kind.model_fields.items():
        is_optional = is_optional or not field.is_required()
        default = field.get_default(call_default_factory=True) if is_optional else inspect.Parameter.empty
        parameters.append(inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=field.annotation))
    return inspect.Signature(parameters)


class UpdateableMixin:
    """Settings that take values of others."""

    def update_from_dict(self, values: Mapping[str, Any], skip_exceptions: bool = False) -> None:
        """Set values by keyword.

        Parameters
        ----------
        values : mapping
            The values.
        skip_exceptions : bool
            True if unknown keywords and invalid values are passed over.

        Raises
        ------
        ValueError
            Unknown keywords, or invalid values.
        """
        for name, value in values.items():
            try:
                known = getattr(type(self), "model_fields", {})
                if name not in known:
                    hint = f"did you mean {' or '.join(get_close_matches(name, known, 1)) or ', '.join(known)}?"
                    raise ValueError(f"{type(self).__name__} has no field {name!r}; {hint}")
                setattr(self, name, value)
            except ValueError:
                if not skip_exceptions:
                    raise

    def update_from_object(self, other: BaseModel, skip_exceptions: bool = False) -> None:
        """Take the values that were given to another object.

        Parameters
        ----------
        other : Model
            The object.
        skip_exceptions : bool
            True if unknown keywords and invalid values are passed over.

        Raises
        ------
        ValueError
            Unknown keywords, invalid values, or an object that has no settings.
        """
        if not isinstance(other, BaseModel):
            raise WrongTypeError(f"expected {type(self).__name__}, found {type(other).__name__}")
        given = (name for name in type(other).model_fields if name in other.model_fields_set)
        self.update_from_dict({name: getattr(other, name) for name in given}, skip_exceptions)


def distribute(values: Mapping[str, Any], *kinds: Iterable[str]) -> list[dict[str, Any]]:
    """Distribute keywords to the first kind that knows each.

    Parameters
    ----------
    values : mapping
        Values by keyword.
    *kinds : iterable of str
        The keywords of each kind.

    Returns
    -------
    list of dict
        The values of each kind.

    Raises
    ------
    ValueError
        No kind knows a keyword.
    """
    known = [list(kind) for kind in kinds]
    shares: list[dict[str, Any]] = [{} for _ in known]
    for name, value in values.items():
        home = next((share for share, names in zip(shares, known, strict=True) if name in names), None)
        if home is None:
            every = [field for names in known for field in names]
            close = get_close_matches(name, every, 1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(every)}"
            raise ValueError(f"unknown keyword {name!r}; {hint}")
        home[name] = value
    return shares
