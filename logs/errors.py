"""Why a log could not be read or written: one class per cause, one sentence each."""


class LogError(ValueError):
    """A log cannot be used; the message is one sentence with what to do."""


class LogNotFound(LogError):
    """There is no file of that name."""


class LogIsDirectory(LogError):
    """The path names a folder."""


class LogNotReadable(LogError):
    """The operating system refuses to read the file."""


class LogEmpty(LogError):
    """The file has no bytes, or its run no sample."""


class NotMcap(LogError):
    """The file is not an MCAP file."""


class ForeignLog(LogError):
    """The file is an MCAP file of another tool."""


class LogDamaged(LogError):
    """So much of the file is damaged that nothing can be recovered."""


class LogBlockError(LogError):
    """Samples or events that do not fit the log to which they are appended."""


class LogPathError(LogError):
    """The log cannot be created where it was asked for."""


class LogWriteError(LogError, OSError):
    """The machine failed while the log was written: a full disk, a lost network share.

    Also an OSError (errno, strerror, filename), so that a program can distinguish a failure of the
    machine from a wrong request.
    """

    def __init__(self, errno: int, sentence: str, filename: str) -> None:
        OSError.__init__(self, errno, sentence, filename)

    def __str__(self) -> str:
        return f"{self.filename}: {self.strerror}"
