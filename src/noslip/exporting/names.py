"""Names in exported C: which are taken, and how those of a whole export are changed."""

from __future__ import annotations

import re

from noslip.errors import InputError

_C = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while main
"""
_CPP = """
alignas alignof and and_eq asm bitand bitor bool catch char16_t char32_t char8_t class co_await
co_return co_yield compl concept consteval constexpr constinit const_cast decltype delete
dynamic_cast explicit export false friend mutable namespace new noexcept not not_eq nullptr operator
or or_eq private protected public reinterpret_cast requires static_assert static_cast template this
thread_local throw true try typeid typename using virtual wchar_t xor xor_eq std
"""
_MATH = """
acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim
floor fma fmax fmin fmod frexp gamma hypot ilogb ldexp lgamma llrint llround log log10 log1p log2
logb lrint lround modf nan nearbyint nextafter nexttoward pow remainder remquo rint round scalbln
scalbn sin sinh sqrt tan tanh tgamma trunc j0 j1 jn y0 y1 yn signgam
"""
_LIBRARY = """
abort abs accept access alarm alloca asctime assert atexit atof atoi atol atoll bind bsearch calloc
chdir chmod clearerr clock close closedir connect creat ctime difftime div dup dup2 environ errno
execl execv exit fclose feof ferror fflush fgetc fgetpos fgets fopen fork fprintf fputc fputs fread
free freopen fscanf fseek fsetpos ftell fwrite getc getchar getenv getpid gets gmtime index ioctl
isalnum isalpha iscntrl isdigit isgraph islower isprint ispunct isspace isupper isxdigit kill labs
ldiv link listen llabs lldiv localeconv localtime longjmp lseek malloc memchr memcmp memcpy memmove
memset mkdir mktime nice open opendir pause perror pipe poll printf putc putchar puts qsort raise
rand random read readdir realloc recv remove rename rewind rindex rmdir scanf select send setbuf
setjmp setlocale setvbuf shutdown sigaction signal sleep snprintf socket sprintf srand srandom
sscanf stat stderr stdin stdout strcat strchr strcmp strcoll strcpy strcspn strerror strftime strlen
strncat strncmp strncpy strpbrk strrchr strspn strstr strtod strtof strtok strtol strtold strtoll
strtoul strtoull strxfrm swab symlink sync system tempnam time tmpfile tmpnam tolower toupper
truncate tzname umask ungetc unlink usleep utime vfork vfprintf vprintf vsnprintf vsprintf wait
write EOF FILE NULL INFINITY NAN HUGE_VAL BUFSIZ RAND_MAX CLOCKS_PER_SEC EXIT_FAILURE EXIT_SUCCESS
ptrdiff_t size_t time_t va_list I
"""
_RESERVED = frozenset(" ".join([_C, _CPP, _MATH, _LIBRARY]).split())
_ASIDE = re.compile(r"/\*.*?\*/|//[^\n]*|(?:\.|->)[A-Za-z_]\w*", re.DOTALL)
"""Comments, and fields of structs."""
_IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)


def checked(what: str, name: str) -> str:
    """Return an identifier that C and C++ leave to programs."""
    if not _IDENTIFIER.fullmatch(name):
        raise InputError(f"{what} must be an identifier of C, got {name!r}")
    # Those of math come with an f or an l, too; what begins with an underscore is the compiler's.
    own = name.removesuffix("f") in _MATH.split() or name.removesuffix("l") in _MATH.split()
    if name in _RESERVED or own or name.startswith("_"):
        raise InputError(
            f"{what}: {name!r} is a name of C or C++ or their libraries; take my_{name}"
        )
    return name


def named(texts: dict[str, str], placeholder: str, name: str) -> dict[str, str]:
    """Put a name in the place of another one, in texts and names of files.

    Raises
    ------
    InputError
        If another file, or anything in the texts, has it already.
    """
    # Where it is not named it may well be the name of something within a function.
    naming = [text for text in texts.values() if placeholder in text]
    naming += [line for text in texts.values() for line in text.splitlines() if "#define" in line]
    taken = set(_IDENTIFIER.findall(_ASIDE.sub("", "\n".join(naming))))
    files = {file.partition(".")[0].lower() for file in texts}
    if name in taken or name.lower() in files:
        raise InputError(f"name: {name!r} is used by the exported code itself; take my_{name}")
    capitals = placeholder.upper(), name.upper()
    return {
        file.replace(placeholder, name): text.replace(placeholder, name).replace(*capitals)
        for file, text in texts.items()
    }


def prefixed(texts: dict[str, str], prefix: str) -> dict[str, str]:
    """Let all names that the linker sees begin with another prefix than ``noslip``."""

    def changed(text: str) -> str:
        text = re.sub(r"\bnoslip_", f"{prefix}_", text)
        return re.sub(r"\bNOSLIP_", f"{prefix.upper()}_", text)

    return {file: changed(text) for file, text in texts.items()}
