"""The paper's section IV anew: its runs, kept results, tables, figures and statements."""
