//! STANAG 4586 Edition 4 DLI messages: wrapper, scalars, one message table, codec.
