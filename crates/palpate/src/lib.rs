//! palpate
